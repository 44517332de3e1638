"""`benchmarks.people`: figures are what their names say, kept kinds are kept, runs go on."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import people, people_unit, people_way
from benchmarks.people_figures import figures_of, table_of
from benchmarks.people_page import markdown_of, means_chart
from benchmarks.report import Report
from ergoqp.simulation.loop import Trace


def way(end: int, **other: object) -> dict:
    usual = {
        "end": end,
        "early": end,
        "early_holds": other.get("holds", True),
        "hand_mm": 1.0,
        "falls_over": False,
        "lived": end,
        "unbalanced": 0.0,
        "holds": True,
        "first_rest": 2.0,
        "rests": True,
        "peak": 4.0,
        "path": 0.5,
        "power": 0.0,
        "force": None,
        "slips": 0,
        "fell": False,
    }
    return usual | other


def unit(start: int, best: int, **ways: dict) -> dict:
    usual = {"still": way(start), "rule": way(3), "own_rule": way(3), "ergoqp": way(best)}
    return {"still": start, "best": best, "kind": "looking", "problem": "desk"} | {
        "ways": usual | ways
    }


def test_figures_are_what_their_names_say() -> None:
    felt = {"force": [1.0, 5.0, 9.0], "slips": 2, "fell": True}
    units = [
        unit(5, 2, ergoqp=way(2, early=4, peak=6.5)),
        unit(5, 2, ergoqp=way(1), rule=way(2)),
        unit(6, 3, ergoqp=way(6, rests=False, first_rest=None, peak=7.0), still=way(5)),
        unit(6, 2, ergoqp=way(7, hand_mm=30.0, holds=False, peak=7.5, **felt)),
    ]
    found = figures_of(units, "ergoqp")
    assert found["share_at_best"] == 0.5
    assert figures_of([unit(5, 2, ergoqp=way(2, holds=False))], "ergoqp")["share_at_best"] == 0.0
    assert found["beats_best"] == 0.25
    assert found["share_at_20s"] == 0.25
    assert found["mean_end"] == 4.0
    assert found["mean_above_best"] == (0 + 0 + 3 + 5) / 4
    assert found["worse_than_start"] == 0.25
    assert found["worse_than_still"] == 0.5
    assert found["worse_than_rule"] == 0.5
    assert found["gain_over_rule"] == pytest.approx((1 + 1 - 3 - 4) / 4)
    assert found["never_rests"] == 0.25
    assert found["first_rest_s"] == 2.0
    assert found["peak_above_start"] == 0.5  # 6.5 over 5, 7.5 over 6; 7 is not more than 6 + 1
    assert found["no_rest"] == found["lets_go"] == 0.25
    assert found["falls_over"] == 0.0
    assert (found["force_median_n"], found["force_peak_n"]) == (1.0, 9.0)
    assert (found["slips"], found["falls"]) == (0.5, 0.25)
    assert figures_of(units, "rule")["gain_over_rule"] == 0.0
    assert "force_peak_n" not in figures_of(units, "rule")


def test_a_trace_is_measured_as_is_said() -> None:
    problem = SimpleNamespace(
        twist_limit=SimpleNamespace(speed=np.ones(6)),
        assess=lambda postures: SimpleNamespace(final=postures[:, 0]),
    )
    trace = Trace()
    for number in range(800):
        # Moves for 2 s, rests for 3 s, moves for the last 3 s; a blip of half a second in between.
        moves = number < 200 or number >= 500
        trace.twists.append(np.array([0.1 if moves else 0.0, 0, 0, 0, 0, 0]))
        trace.time.append(0.01 * number)
        trace.postures.append(np.full(32, 9 if 300 <= number < 340 else 5))
        trace.forces.append(np.full(6, np.nan))
        trace.slips.append(0)
        trace.unbalanced.append(False)
    found = people_way.of_trace(problem, trace, 0.01)  # type: ignore[arg-type]
    assert found["first_rest"] == pytest.approx(2.0)
    assert not found["rests"]
    assert found["peak"] == 5.0
    assert found["path"] == pytest.approx(0.5)
    assert found["force"] is None
    trace.postures[300:500] = [np.full(32, 9)] * 200
    found = people_way.of_trace(problem, trace, 0.01)  # type: ignore[arg-type]
    assert found["peak"] == 9.0
    trace.forces = [np.array([float(number), 0, 0, 0, 0, 0]) for number in range(800)]
    trace.fell, trace.let_go = 3.0, 1.0
    found = people_way.of_trace(problem, trace, 0.01)  # type: ignore[arg-type]
    assert found["force"][2] == pytest.approx(100.0, abs=1.0), "until the hand lets go"


def test_the_kept_kinds_are_not_for_building() -> None:
    options = people.parser().parse_args(["--tuning", "--kinds", "looking,stepping"])
    with pytest.raises(SystemExit, match="for judging only"):
        people.measure(Report(full=False), options)
    assert not set(people.KEPT) & {"alike", "mass"}
    assert set(people.KEPT) < set(people.OTHERS)
    quick = people.units_of(people.OTHERS, ("screwing", "desk"), False, people.JUDGING)
    full = people.units_of(people.OTHERS, ("screwing", "desk"), True, people.JUDGING)
    assert set(quick) <= set(full), "the quick sample is a part of the full one"
    assert {unit[0] for unit in quick} == set(people.OTHERS)
    assert len(full) == 20 * 2 * len(people.OTHERS)
    tuning = people.units_of(people.OTHERS, ("screwing",), True, people.TUNING)
    assert not {unit[2] for unit in tuning} & {unit[2] for unit in full}


def test_nobody_wins_by_taking_the_object_away() -> None:
    lost = unit(6, 3, ergoqp=way(1, holds=False, falls_over=True))
    found = figures_of([lost], "ergoqp")
    assert found["mean_end"] == 6.0
    assert (found["share_at_best"], found["share_at_20s"], found["beats_best"]) == (0.0, 0.0, 0.0)
    assert found["gain_over_rule"] == -3.0
    assert found["falls_over"] == 1.0
    ruled = figures_of([unit(6, 3, rule=way(1, holds=False))], "ergoqp")
    assert ruled["gain_over_rule"] == 3.0
    back = unit(6, 3, ergoqp=way(3, early=2, early_holds=False))
    assert figures_of([back], "ergoqp")["share_at_20s"] == 0.0
    late = unit(6, 3, ergoqp=way(2, early=3, early_holds=True, holds=False))
    assert figures_of([late], "ergoqp")["share_at_20s"] == 1.0


def test_kinds_say_whether_they_rest_where_the_object_is_left_alone(capsys) -> None:
    rests = {"from_rest_deg": 0.1, "slid_mm": 0.2, "hand_mm": 1.0}
    units = [
        unit(5, 2, **{name: way(4, **rests) for name in ("still", "ergoqp", "rule", "own_rule")})
        | {"follows": [True, False], "routes": [1, 4], "held_mm": 2.5}
        for _ in range(4)
    ]
    units[0]["ways"]["still"]["from_rest_deg"] = 3.0
    units[1]["ways"]["still"] |= {"holds": False, "hand_mm": 40.0}
    units[2]["ways"]["ergoqp"]["slid_mm"] = 7.0
    report = Report(full=False)
    people.print_kind(report, "looking", units)
    assert report.figures["looking.follows_still"] == 0.5
    assert report.figures["looking.led_to_rest"] == 0.5
    assert report.figures["looking.sole_mm"] == 7.0
    assert report.figures["looking.hand_mm.still"] == 40.0
    assert report.figures["looking.hold_mm"] == 2.5
    assert report.figures["looking.route_matters"] == 0.25


def test_cells_without_enough_starts_go_on() -> None:
    found = [
        {"kind": kind, "problem": "desk", "drawn": kind == "looking" or number > 2}
        for kind in ("looking", "pushed")
        for number in range(people.STARTS)
    ]
    assert people.missing(found, 1000) == [("pushed", "desk", 1020 + i) for i in range(3)]
    never = [{"kind": "pushed", "problem": "desk", "drawn": False}] * people.SEEDS
    assert people.missing(never, 1000) == []


def test_finished_units_are_not_run_again(tmp_path, monkeypatch, capsys) -> None:
    kept = ("follower", "desk", 1000)
    folder = tmp_path / people.digest("follower")
    folder.mkdir()
    (folder / "follower-desk-1000.json").write_text('{"drawn": false, "cpu_s": 1.0}')
    found = people.finished([kept], tmp_path, Report(full=False))
    assert found == [{"drawn": False, "cpu_s": 1.0}]
    assert "0 to run" in capsys.readouterr().out


def test_a_unit_is_drawn_again_alike_and_its_start_is_as_bad_as_it_must_be() -> None:
    one, same = (people_unit.draw_unit("follower", "desk", 7) for _ in range(2))
    assert not isinstance(one, str)
    assert not isinstance(same, str)
    np.testing.assert_array_equal(one.start.posture, same.start.posture)
    assert one.still >= one.best + people_unit.ABOVE
    assert one.still == one.problem.assess(one.start.posture).final[0]
    still = people_unit.way_of(one, "still")
    assert still["end"] == one.still
    assert still["path"] == 0.0
    assert still["from_rest_deg"] < 2.0


def test_units_say_how_people_follow_and_whether_ways_matter() -> None:
    one = people_unit.draw_unit("follower", "desk", 7)
    assert not isinstance(one, str)
    assert people_unit.follows_of(one) == [True, True]
    differ, count = people_unit.routes_of(one)
    assert 0 <= differ <= count <= 4
    assert count > 0


class Restless:
    """Comes to rest wherever it is, and never stays there."""

    def __init__(self, sways: float) -> None:
        self.pose, self.posture, self._sways, self._number = np.eye(4), np.zeros(32), sways, 0
        self.person = SimpleNamespace(kind="follower")
        self.places: list[np.ndarray] = []

    def copy(self) -> Restless:
        other = Restless(self._sways)
        other.pose, other.posture, other.places = self.pose, self.posture, self.places
        return other

    def follow(self, pose: np.ndarray, dt: float) -> None:
        self.places.append(pose[:3, 3])
        self.pose, self._number = pose, self._number + 1
        self.posture = np.full(32, self._sways * np.sin(self._number / 20))

    def rest(self, pose: np.ndarray) -> bool:
        self.posture = np.zeros(32)
        return True


@pytest.mark.parametrize(("sways_deg", "follows"), [(1.0, True), (5.0, False)])
def test_who_sways_about_their_rest_does_not_follow(
    monkeypatch, sways_deg: float, follows: bool
) -> None:
    home = Restless(np.radians(sways_deg))
    unit = SimpleNamespace(
        problem=SimpleNamespace(name="desk"),
        person=SimpleNamespace(kind="follower"),
        home=home,
        seed=3,
    )
    monkeypatch.setattr(
        people_unit.judged("desk")[1], "carried", lambda *given: SimpleNamespace(score=3)
    )
    assert people_unit.follows_of(unit) == [follows, follows]  # type: ignore[arg-type]
    steps = np.linalg.norm(np.diff(home.places[:200], axis=0), axis=1)
    assert steps.max() < 0.16 * 0.02 + 1e-9, "at 0.15 m/s, no jumps"


def test_tables_say_the_same_as_figures() -> None:
    units = [unit(5, 2), unit(6, 3)]
    row = table_of(units, ["ergoqp"])[0]
    assert row[:2] == ("ergoqp", "2.50")
    text = markdown_of(units, ["still", "rule", "ergoqp"])
    assert "| still | 5.50 |" in text
    assert "| looking | 5.5 / 3.0 / 2.5 / 2.5 |" in text
    assert "<svg" in means_chart(units)
