"""Which place is tried next, which one is kept, and why, judged by measurements at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from ergoqp.arguments import Range, check_parameters, check_text, check_whole
from ergoqp.expressions import read_pose
from ergoqp.identification.loops import Resting
from ergoqp.identification.promising import Candidate

THEIRS: Final = "this person's best"
"""Name of places that promise to be better for the identified person."""

DESCENT: Final = "descent"
"""Name of the place where descent alone comes to rest."""

_SAME: Final = (0.03, float(np.radians(5.0)))
"""Places this close to each other count as one [m], [rad]."""

_TAKES: Final = 12.0
"""Least duration of a try and the return after it: none is begun if less time is left [s]."""

_AGAIN: Final = 3
"""This many worse rests in a row are no accident: the person, or the way they work, has changed."""


@dataclass(frozen=True)
class SeekOptions:
    """How places are tried.

    Attributes:
        tries: largest number of places that are tried, including that of descent.
        worth: smallest promised improvement over the best measured score for which a place is tried
            for the identified person [points].
        longest: time after which no place is tried any more, and the object has returned to the
            best one [s].
        patience: time after the arrival of the object after which a try ends if the person has not
            come to rest [s].
        better: smallest improvement of the score for which the object returns to a place [points].
        enough: the search ends at a score this little above that of a person who stands at ease
            [points].
        returns: how often the object returns to the best place. The score there may differ the
            second time.
        worse: at the end the object stays. All places are tried again if the person there scores
            this much worse than measured [points], or if somebody has moved the object elsewhere.

    Raises:
        InputError: if a value has the wrong type or is out of range.

    Example:
        >>> import ergoqp
        >>> from ergoqp.seeking import SeekOptions
        >>> problem = ergoqp.load_problem("screwing")
        >>> seeker = ergoqp.Seeker(problem, how=SeekOptions(tries=3, longest=30.0), thinks=False)
        >>> seeker.seeks
        True
    """

    tries: int = 6
    worth: Annotated[float, Range(0.0, 1e6)] = 0.05
    longest: Annotated[float, Range(0.0, 1e6, "s")] = 60.0
    patience: Annotated[float, Range(0.0, 1e6, "s")] = 15.0
    better: Annotated[float, Range(0.0, 1e6)] = 0.2
    enough: Annotated[float, Range(0.0, 1e6)] = 0.5
    returns: int = 2
    worse: Annotated[float, Range(0.0, 1e6)] = 1.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("tries", "returns"):
            check_whole(f"seeking.{name}", getattr(self, name), 0, 100)
        check_parameters(self, "seeking.")


@dataclass(frozen=True, eq=False)
class Place:
    """A place to try.

    Attributes:
        name: a few words.
        pose: pose of the object (4, 4) [m].

    Raises:
        InputError: if the pose is not rigid.

    Example:
        >>> import numpy as np
        >>> from ergoqp.seeking import Place
        >>> pose = np.eye(4)
        >>> pose[:3, 3] = 0.4, 0.0, 1.1
        >>> Place("before the chest", pose).name
        'before the chest'
    """

    name: str
    pose: np.ndarray

    def __post_init__(self) -> None:
        """Check name and pose."""
        check_text("place.name", self.name)
        object.__setattr__(self, "pose", read_pose("place.pose", self.pose))


@dataclass(frozen=True, eq=False)
class Try:
    """The result of one try.

    Attributes:
        name: name of the place.
        why: why the object went there.
        begun: time at which the object set out [s].
        ended: time at which the place was judged [s].
        pose: pose at which the object came to rest (4, 4) [m].
        score: measured score of the person at rest there [points]; NaN if they did not rest.
        note: result in words.

    Example:
        >>> import numpy as np
        >>> from ergoqp.seeking.next_place import Try
        >>> tried = Try("descent", "it begins here", 0.0, 4.5, np.eye(4), 2.1, "")
        >>> tried.ended - tried.begun
        4.5
    """

    name: str
    why: str
    begun: float
    ended: float
    pose: np.ndarray
    score: float
    note: str


class SearchState:
    """The record of a loop that tries places, and its next move.

    Args:
        places: places to try, the most promising first.
        how: how many, and for how long.
        floor: score of standing at ease, which no work can beat [points].
        thinks: whether an identification can promise scores of other places from the rests.

    Attributes:
        account: all tries.
        rests: the tries in which the person came to rest.
        best: the rest with the lowest score, as measured last.
        going: place that the object goes to; None: descent.
        returning: whether the object goes back to the best place.
        thinking: whether the loop waits for `suggested`.
        done: whether no place is tried any more.
    """

    def __init__(
        self, places: Sequence[Place], how: SeekOptions, floor: float, thinks: bool = False
    ) -> None:
        """Begin with descent."""
        self.how, self.floor, self._places, self._thinks = how, floor, list(places), thinks
        self.begin(0.0)

    def begin(self, now: float) -> None:
        """Begin again at a time of the loop [s]."""
        self.account: list[Try] = []
        self.best: Try | None = None
        self.going: Place | None = None
        self.returning = self.done = self.thinking = False
        self.rests: list[Try] = []
        self._left, self._in_vain = list(self._places), []
        self._returned, self._began, self._since, self._arrived = 0, now, now, now
        self._last, self._windows, self._promised = np.inf, 0, 0.0

    def overdue(self, now: float) -> bool:
        """Return whether the time of the present try is over."""
        waits = self.done or self.thinking
        return not waits and now - self._arrived > self.how.patience

    def on_the_way(self, now: float) -> None:
        """Note that the object is still on its way, because some robots are slow."""
        self._arrived = now

    def unrested(self, now: float, pose: np.ndarray) -> Place | None:
        """Note that the person did not rest; return the next place to go to, None to stay."""
        return self._next(self._noted(now, pose, np.nan, "no rest"))

    @property
    def kept(self) -> bool:
        """Whether the object is, at the end, at the place with the best measured score."""
        best = self.best
        return self.done and best is not None and self._last <= best.score + self.how.better

    def worsened(self, pose: np.ndarray, score: float) -> bool:
        """Return whether, at the end, all places are to be tried again.

        It is so after several rests that score too much worse, or that are at another place.
        """
        moved = bool(self.account) and _apart(pose, self.account[-1].pose) > 1.0
        # If the person had not come to rest, a rest with a bad score counts as worse too.
        worse = not score <= self._last + self.how.worse
        another = moved or (worse and not self._well(score))
        self._windows = self._windows + 1 if another else 0
        return self._windows >= _AGAIN

    def measured(self, rest: Resting, score: float) -> Place | None:
        """Note a rest; return the next place to go to, None to stay.

        Args:
            rest: place and time of the rest.
            score: score of the person there [points].
        """
        note = "measured"
        if self.going is not None and self.account:
            to_goal = _apart(rest.pose, self.going.pose)
            if _apart(rest.pose, self.account[-1].pose) < min(1.0, to_goal):
                note = "came back: the way there cost too much"
                self._in_vain.append(self.going.pose)
        return self._next(self._noted(rest.time, rest.pose, score, note))

    def suggested(self, now: float, promises: Sequence[Candidate]) -> Place | None:
        """Return the next place to go to, one that promises most; None to stay."""
        self.thinking, self._since, self._arrived = False, now, now
        for promise in promises:
            if promise.gain < self.how.worth:
                break
            if self._is_new(promise.pose):
                self._promised = promise.gain
                self.going = Place(THEIRS, promise.pose)
                return self.going
        return self._home(self.account[-1])

    def _is_new(self, pose: np.ndarray) -> bool:
        known = [*(each.pose for each in self.account), *self._in_vain]
        return all(_apart(pose, each) > 1.0 for each in known)

    def _noted(self, now: float, pose: np.ndarray, score: float, note: str) -> Try:
        name = DESCENT if self.going is None else self.going.name
        why = "returned to" if self.returning else "to be tried" if self.going else "downhill"
        if name == THEIRS and not self.returning:
            why = f"promises {self._promised:.1f} points"
        noted = Try(name, why, self._since - self._began, now - self._began, pose, score, note)
        if self.returning and np.isfinite(score) and self.best in self.rests:
            # The last score of a place counts.
            self.rests.remove(self.best)
        self.account.append(noted)
        if np.isfinite(score):
            self.rests.append(noted)
        self._since = self._arrived = now
        return noted

    def _next(self, last: Try) -> Place | None:
        before, self.best = self.best, min(self.rests, key=lambda each: each.score, default=None)
        if self.returning and before is not None:
            # If the best place scores worse than before, other places may now be better.
            self.returning = last.score <= before.score + self.how.better
        if not self.returning and self._seeks(last):
            while self._left:
                place = self._left.pop(0)
                if self._is_new(place.pose):
                    self.going = place
                    return place
            if self._thinks and len(self.rests) > 1:
                self.thinking = True
                return None
        return self._home(last)

    def _home(self, last: Try) -> Place | None:
        """Return to the best place, or end where the object is."""
        best = self.best
        worse = best is not None and not last.score <= best.score + self.how.better
        if best is None or not worse or self._returned >= self.how.returns:
            self.done, self.returning = True, False
            self._last, self._windows = last.score, 0
            return None
        self._returned += 1
        self.returning, self.going = True, Place(best.name, best.pose)
        return self.going

    def _seeks(self, last: Try) -> bool:
        """Return whether another place is worth a try, and there is time for it."""
        how, best = self.how, self.best
        good = best is not None and self._well(best.score)
        takes = max(_TAKES, *(each.ended - each.begun for each in self.account))
        late = last.ended + takes > how.longest
        return len(self.account) < how.tries and not late and not good

    def _well(self, score: float) -> bool:
        return score <= self.floor + self.how.enough


def _apart(pose: np.ndarray, other: np.ndarray) -> float:
    """Return the distance of two places; below 1 they count as one."""
    turn = float(np.arccos(np.clip(pose[:3, 0] @ other[:3, 0], -1.0, 1.0)))
    way = float(np.linalg.norm(pose[:3, 3] - other[:3, 3]))
    return max(way / _SAME[0], turn / _SAME[1])
