"""`benchmarks.people`: figures are what their names say, kept kinds are kept, runs go on."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import people, people_draw, people_page, people_print, people_unit, people_way
from benchmarks.people_figures import best_of, figures_of, table_of
from benchmarks.people_page import markdown_of, means_chart
from benchmarks.report import Report
from ergoqp.lab.yardstick import Still
from ergoqp.problem.settings import DeclaredRobot
from ergoqp.seeking.seeker import a_place
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
        "moves": 1,
        "seconds": 30.0,
        "tries": None,
        "broken": 0,
    }
    return usual | other


def unit(start: int, best: int, **ways: dict) -> dict:
    usual = {"still": way(start), "rule": way(3), "own_rule": way(3), "ergoqp": way(best)}
    usual["descent"] = way(3)
    return {"still": start, "best": best, "kind": "looking", "problem": "desk"} | {
        "ways": usual | ways
    }


def test_figures_are_what_their_names_say() -> None:
    felt = {"force": [1.0, 5.0, 9.0], "slips": 2, "fell": True}
    units = [
        unit(5, 2, ergoqp=way(2, early=4, peak=6.5, tries=2, broken=3, moves=4)),
        unit(5, 2, ergoqp=way(1, tries=5, first_rest=21.0), rule=way(2)),
        unit(6, 3, ergoqp=way(6, rests=False, first_rest=None, peak=7.0), still=way(5)),
        unit(6, 2, ergoqp=way(7, hand_mm=30.0, holds=False, peak=7.5, **felt)),
    ]
    found = figures_of(units, "ergoqp")
    assert [best_of(each) for each in units] == [2, 1, 3, 2]
    assert found["share_at_best"] == 0.5
    assert figures_of([unit(5, 2, ergoqp=way(2, holds=False))], "ergoqp")["share_at_best"] == 0.0
    assert found["beats_yardstick"] == 0.25
    assert found["share_at_20s"] == 0.25
    assert found["mean_end"] == 4.0
    assert found["mean_above_best"] == (0 + 0 + 3 + 5) / 4
    assert found["worse_than_start"] == 0.25  # the fourth, and so are both of the next two
    assert found["worse_than_still"] == 0.5
    assert found["worse_than_rule"] == 0.5
    assert found["gain_over_rule"] == pytest.approx((1 + 1 - 3 - 4) / 4)
    assert found["never_rests"] == 0.25
    assert found["first_rest_s"] == 11.5
    assert found["first_rest_in_20s"] == 0.5
    assert (found["tries"], found["limits_broken"]) == (3.5, 3.0)
    assert found["moves_per_minute"] == pytest.approx(7 / 2)
    assert "tries" not in figures_of(units, "rule")
    assert found["peak_above_start"] == 0.5  # 6.5 over 5, 7.5 over 6; 7 is not more than 6 + 1
    assert found["no_rest"] == found["lets_go"] == 0.25
    assert found["falls_over"] == 0.0
    assert (found["force_median_n"], found["force_peak_n"]) == (1.0, 9.0)
    assert found["force_tires"] == 0.0
    tired = [unit(5, 2, ergoqp=way(2, force=[n, 90.0, 90.0])) for n in (24.0, 26.0)]
    assert figures_of(tired, "ergoqp")["force_tires"] == 0.5
    assert (found["slips"], found["falls"]) == (2.0, 1.0), "of people with mass alone"
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
    assert found["moves"] == 2, "at the beginning and after the rest"
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


def test_only_who_was_at_rest_sets_off() -> None:
    still = [True] * 10
    assert people_way.departures(np.array(still), 5) == 0
    assert people_way.departures(np.array([False, True, False, True]), 5) == 1
    assert people_way.departures(np.array([*still, False, *still[:4], False]), 5) == 1
    assert people_way.departures(np.array([*still, False, *still[:5], False]), 5) == 2


@pytest.mark.slow
def test_a_part_is_taken_away_where_it_is_there_for_somebody(monkeypatch, capsys) -> None:
    problem, blind = people_draw.judged("desk")[0], people_draw.unseeing("desk")
    assert problem.response.looks  # type: ignore[attr-defined]
    assert not blind.response.looks  # type: ignore[attr-defined]
    assert people_unit.TAKEN.keys() == {"looking"}
    for name in ("unseeing_optimum", "model_optimum"):
        monkeypatch.setattr(people_unit, name, lambda _: SimpleNamespace(pose=a_place(problem)))
    for method, looks in (("", True), ("without_gaze", False)):
        seeker = people_unit._built.__wrapped__("desk", method, None)
        assert seeker.problem.response.looks is looks  # type: ignore[attr-defined]
    found = [
        unit(5, 2, **{name: way(4) for name in people_print.WAYS}, without_gaze=way(3)),
        unit(5, 2, **{name: way(4) for name in people_print.WAYS}),
    ]
    report = Report(full=False)
    people_print.print_ways(report, "looking", found[:1])
    people_print.print_ways(report, "", found)
    assert report.figures["looking.mean_end.without_gaze"] == 3.0
    assert "mean_end.without_gaze" not in report.figures


def test_the_kept_kinds_are_not_for_building() -> None:
    options = people.parser().parse_args(["--tuning", "--kinds", "looking,stepping"])
    with pytest.raises(SystemExit, match="for judging only"):
        people.measure(Report(full=False), options)
    assert not set(people.KEPT) & {"alike", "mass"}
    assert set(people.KEPT) < set(people.OTHERS)
    quick = people.units_of(people.OTHERS, ("screwing", "desk"), False, people.JUDGING)
    full = people.units_of(people.OTHERS, ("screwing", "desk"), True, people.JUDGING)
    assert set(quick) <= set(full), "the quick sample is a part of the full one"
    assert {unit[0] for unit in quick} == set(people.OTHERS[: people.MANY])
    assert len(full) == 20 * 2 * len(people.OTHERS)
    tuning = people.units_of(people.OTHERS, ("screwing",), True, people.TUNING)
    assert not {unit[2] for unit in tuning} & {unit[2] for unit in full}


def test_nobody_wins_by_taking_the_object_away() -> None:
    lost = unit(6, 3, ergoqp=way(1, holds=False, falls_over=True))
    found = figures_of([lost], "ergoqp")
    assert found["mean_end"] == 6.0
    names = ("share_at_best", "share_at_20s", "beats_yardstick")
    assert [found[name] for name in names] == [0.0, 0.0, 0.0]
    # As low as the start and the rule, and worse than either: there the person has a rest.
    names = ("worse_than_start", "worse_than_still", "worse_than_rule", "worse_than_own_rule")
    assert [found[name] for name in names] == [1.0, 1.0, 1.0, 1.0]
    same = way(1, holds=False)
    assert figures_of([unit(6, 3, ergoqp=same, rule=same)], "ergoqp")["worse_than_rule"] == 0.0
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
        unit(
            5,
            2,
            **{
                name: way(4, **rests) for name in ("still", "ergoqp", "rule", "own_rule", "descent")
            },
        )
        | {
            "follows": (True, False, None)[number % 3],
            "routes": [1, 4],
            "held_mm": 2.5,
            "tries": {},
        }
        for number in range(4)
    ]
    units[0]["ways"]["still"]["from_rest_deg"] = 3.0
    units[1]["ways"]["still"] |= {"holds": False, "hand_mm": 40.0}
    units[2]["ways"]["ergoqp"]["slid_mm"] = 7.0
    units[3]["ways"]["still"]["slid_mm"] = 0.4
    report = Report(full=False)
    tries = {"places": 10, "without_rest": 4, "fell_at_start": 2}
    others = [{"held_mm": 7.5, "tries": tries}]
    people_print.print_kind(report, "looking", units, [*units, *others])
    assert report.figures["looking.follows_still"] == 0.5
    assert report.figures["looking.led_to_rest"] == pytest.approx(2 / 3)
    assert report.figures["looking.sole_mm"] == 7.0
    assert report.figures["looking.sole_mm.still"] == 0.4
    assert report.figures["looking.hand_mm.still"] == 40.0
    assert report.figures["looking.hold_mm"] == 7.5, "who fell counts too"
    assert report.figures["looking.fell_at_start"] == 2
    assert report.figures["looking.without_rest"] == 0.4
    assert report.figures["looking.route_matters"] == 0.25


def test_every_figure_is_printed_once_of_all_kinds_problems_and_cells(capsys) -> None:
    rests = {"from_rest_deg": 0.1, "slid_mm": 0.2}
    found = [
        unit(5, 2, **{name: way(4, **rests) for name in people_print.WAYS})
        | {"kind": kind, "problem": name, "drawn": True, "anywhere": 3, "follows": True}
        | {"held_mm": 0.0, "tries": {"places": 2, "without_rest": 1}, "routes": [0, 1]}
        for kind in ("looking", "stepping")
        for name in ("desk", "screwing")
    ]
    fell = {"kind": "stepping", "problem": "desk", "drawn": False, "held_mm": 3.0}
    found.append(fell | {"tries": {"fell_at_start": 20}})
    report = Report(full=False)
    people_print.print_figures(report, found, people.KEPT)
    figures, shown = report.figures, capsys.readouterr().out
    assert (figures["units"], figures["starts"], figures["starts_least"]) == (5, 4, 1)
    assert figures["kept.fell_at_start"] == figures["stepping.fell_at_start"] == 20
    assert figures["desk.fell_at_start"] == 20
    assert figures["looking.fell_at_start"] == 0
    assert figures["mean_best_anywhere"] == figures["mean_best"] == 2
    for group in ("", "looking.", "desk.", "kept.", "stepping.screwing."):
        for name in ("share_at_best", "path_m", "first_rest_s"):
            assert {f"{group}{name}", f"{group}{name}.still", f"{group}{name}.rule"} <= set(figures)
    assert "\npath_m.still" in shown
    assert "desk.path_m" not in shown, "too many to be read"
    nobody = Report(full=False)
    people_print.print_figures(nobody, [fell | {"tries": {}}], people.KEPT)
    assert nobody.figures["starts"] == 0


def test_a_loop_ends_when_the_object_goes_nowhere() -> None:
    for still in (6.0, 10.0):
        person = Restless(0.0)
        watch = people_way.Watch(person.pose, still)
        for number in range(1, 5000):
            now = 0.01 * number
            # It moves until 15 s, then trembles by less than what counts.
            shift = 0.1 * min(now, 15.0) + 1e-3 * np.sin(now)
            person.pose = np.eye(4)
            person.pose[0, 3] = shift
            person.gap = now
            if watch(now, person):  # type: ignore[arg-type]
                break
        assert now == pytest.approx(15.0 + still, abs=0.3)
        assert (watch.early is not None) == (now > people_way.EARLY)
        if watch.early is not None:
            assert watch.early.gap == pytest.approx(people_way.EARLY, abs=0.2)


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


def test_one_unit_that_fails_costs_no_other(tmp_path, monkeypatch) -> None:
    """Nor one whose numbers no file takes; both are named."""
    monkeypatch.setattr(people, "run_unit", half_of_them)
    monkeypatch.setattr(people, "prepared", lambda problems, quick: ThreadPoolExecutor(2))
    left = {("follower", "desk", seed): tmp_path / f"{seed}.json" for seed in range(6)}
    with pytest.raises(SystemExit) as stopped:
        people.run_all(left, Report(full=False))
    assert {path.name for path in tmp_path.iterdir()} == {"2.json", "3.json", "4.json", "5.json"}
    assert "follower-desk-0: RuntimeError: no" in str(stopped.value)
    assert "follower-desk-1: ValueError" in str(stopped.value)


def half_of_them(kind: str, name: str, seed: int) -> dict:
    if seed == 0:
        raise RuntimeError("no")
    return {"cpu_s": float("nan") if seed == 1 else 1.0}


def test_what_changes_while_units_run_is_not_what_they_ran_with(tmp_path, monkeypatch) -> None:
    people.digest.cache_clear()
    monkeypatch.setattr(people, "_ROOT", tmp_path)
    for name in ("ergoqp/loop.py", "benchmarks/people_draw.py", "benchmarks/people_unit.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("a")
    (tmp_path / "benchmarks" / "people_way.py").write_text("a")
    before = people.digest("looking")
    (tmp_path / "ergoqp" / "loop.py").write_text("b")
    assert people.digest("looking") == before
    with pytest.raises(SystemExit, match="changed while its units ran"):
        people.finished([("looking", "desk", 0)], tmp_path / "out", Report(full=False))
    people.digest.cache_clear()
    assert people.digest("looking") != before
    people.digest.cache_clear()


@pytest.mark.slow
def test_drives_go_where_the_living_person_comes_along(monkeypatch) -> None:
    """A slow hand that is asked first stops short; only who lets go of the drive does so too."""
    one = drawn_unit("follower", "desk", 7)
    goal = people_draw.model_optimum("desk").pose
    monkeypatch.setattr(type(one.start), "carry", lambda self, pose: False)
    np.testing.assert_array_equal(people_unit.come_along(one, goal), goal)
    far = goal.copy()
    far[:3, 3] += 3.0
    np.testing.assert_array_equal(people_unit.come_along(one, far), one.start.pose)


@pytest.mark.slow
@pytest.mark.parametrize("holds", [True, False])
def test_a_soft_robot_is_tried_even_where_a_slow_hand_arrives(monkeypatch, holds) -> None:
    one, goal = drawn_unit("follower", "desk", 7), people_draw.model_optimum("desk").pose
    tried = []
    monkeypatch.setattr(type(one.start), "carry", lambda self, pose: True)
    monkeypatch.setattr(people_unit, "run_loop", lambda told, *_, **__: tried.append(told.robot))
    monkeypatch.setattr(people_unit, "rested", lambda *_: SimpleNamespace(holds=holds))
    assert people_unit.come_along(one, goal) is goal
    assert not tried, "whoever is led by a stiff robot comes along with it as with a slow hand"
    soft = replace(one, person=Soft(one.person))  # type: ignore[arg-type]
    assert np.array_equal(people_unit.come_along(soft, goal), goal if holds else one.start.pose)
    assert tried == [soft.person.robot]


class Soft:
    """A person whose robot is a soft one."""

    def __init__(self, person: object) -> None:
        self.person, self.robot = person, DeclaredRobot(lag=0.08)

    def __getattr__(self, name: str) -> object:
        return getattr(self.person, name)


def test_loops_end_later_where_a_push_is_still_to_come() -> None:
    problem = people_draw.judged("desk")[0]
    still, stepper = Still(problem), people_unit.Gradient(problem, problem.cost)
    drive = people_unit.Drive(problem, np.eye(4), np.eye(4))
    for kind in people.OTHERS:
        waits = people_way.PUSHED if kind in ("pushed", "trembling") else people_way.DONE
        assert people_unit.still_of(still, kind) == waits
        assert people_unit.still_of(drive, kind) == people_way.DONE
        assert people_unit.still_of(stepper, kind) == people_way.STILL


def test_the_page_names_the_worst_runs_first_and_who_is_left_without_a_rest(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(people_page, "_write_replay", lambda unit, path: None)
    units = [
        unit(5, 2, ergoqp=way(end, holds=end != 4)) | {"seed": end, "drawn": True}
        for end in (2, 3, 4)
    ]
    ways = ("ergoqp", "descent", "still", "rule", "own_rule")
    html = people_page.write_people_page(units, ways, tmp_path).read_text()
    said = [f"seed {seed}: 5 to {end}; by the rule 3" for seed, end in ((3, 3), (2, 2))]
    said.insert(0, "seed 4: 5 to 4 without a rest; by the rule 3")
    places = [html.index(words) for words in said]
    assert places == sorted(places)


@pytest.mark.slow
def test_a_unit_is_drawn_again_alike_and_its_start_is_as_bad_as_it_must_be() -> None:
    one, same = (drawn_unit("follower", "desk", 7) for _ in range(2))
    np.testing.assert_array_equal(one.start.posture, same.start.posture)
    assert one.still >= one.best + people_draw.ABOVE
    assert one.still == one.problem.assess(one.start.posture).final[0]
    still = people_unit.way_of(one, Still(one.problem))
    assert still["end"] == one.still
    assert still["path"] == 0.0
    assert still["from_rest_deg"] < 2.0


@pytest.mark.slow
def test_units_say_how_people_follow_and_whether_ways_matter() -> None:
    one = drawn_unit("follower", "desk", 7)
    assert people_unit.follows_of(one) is True
    assert people_unit.routes_of(one)[1] > 0


class Remembers:
    """Rests at a place as the place before it has it; does not come to the nearest ones."""

    def __init__(self, places: tuple[int, ...] = ()) -> None:
        self.places = places

    def copy(self) -> Remembers:
        return Remembers(self.places)

    def carry(self, pose: int) -> bool:
        self.places = (*self.places, pose)
        return pose != 7


@pytest.mark.parametrize(("matters", "differ"), [(True, 1), (False, 0)])
def test_routes_matter_where_the_place_before_does(monkeypatch, matters, differ) -> None:
    """Of two detours, one by a place that is not reached, one place scores otherwise."""

    def carried(start: Remembers, place: int) -> SimpleNamespace:
        return SimpleNamespace(score=2 + (len(start.places) if matters else 0))

    asked = iter([1, 2, 3, 7])
    judge = SimpleNamespace(
        carried=carried, workspace=SimpleNamespace(pose=lambda point: next(asked))
    )
    monkeypatch.setattr(people_unit, "judged", lambda name: (None, judge))
    one = SimpleNamespace(
        problem=SimpleNamespace(name=""),
        person=SimpleNamespace(kind="follower"),
        start=Remembers(),
        seed=0,
    )
    assert people_unit.routes_of(one) == [differ, 1]  # type: ignore[arg-type]


def drawn_unit(kind: str, name: str, seed: int) -> people_draw.Unit:
    unit = people_draw.draw_unit(kind, name, seed).unit
    assert unit is not None
    return unit


class Falls:
    """Falls in holding still, the first few times; has a rest anywhere."""

    times = 0

    def __init__(self) -> None:
        self.fallen, self.pose, self.gap = False, np.eye(4), 0.0

    def copy(self) -> Falls:
        return Falls()

    def carry(self, pose: np.ndarray) -> bool:
        return True

    def rest(self, pose: np.ndarray) -> bool:
        return True

    def follow(self, pose: np.ndarray, dt: float) -> None:
        self.gap = 0.02 if Falls.times < 3 else 0.001


def test_who_falls_at_a_start_is_counted(monkeypatch) -> None:
    problem, judge = people_draw.judged("desk")

    def held(start: Falls, seconds: float) -> float:
        Falls.times += 1
        start.fallen = Falls.times <= 3
        return 20.0 if start.fallen else 1.0

    person = SimpleNamespace(
        body=people_draw.person_of(problem).body, comfort=None, hold=lambda *_, **__: Falls()
    )
    place = SimpleNamespace(score=6, pose=np.eye(4))
    monkeypatch.setattr(people_draw, "person_of_kind", lambda *_: person)
    monkeypatch.setattr(people_draw, "model_optimum", lambda name: place)
    monkeypatch.setattr(people_draw, "hold_still", held)
    monkeypatch.setattr(people_draw, "rested", lambda *_: SimpleNamespace(score=6))
    monkeypatch.setattr(judge, "best", lambda *_, **__: [SimpleNamespace(score=2)])
    monkeypatch.setattr(judge, "carried", lambda *_: place)
    drawn = people_draw.draw_unit("mass", "desk", 1)
    assert drawn.unit is not None
    assert drawn.tries["fell_at_start"] == 3
    assert drawn.tries["places"] == 4
    assert drawn.held_mm == 20.0


class Restless:
    """Comes to rest wherever it is, and never stays there."""

    def __init__(self, sways: float) -> None:
        self.pose, self.posture, self._sways, self._number = np.eye(4), np.zeros(32), sways, 0
        self.person, self.gap, self.fallen = SimpleNamespace(kind="follower"), 0.0, False
        self.slid, self.unbalanced = 0.0, False
        self.places: list[np.ndarray] = []

    def copy(self) -> Restless:
        other = Restless(self._sways)
        other.pose, other.posture, other.places = self.pose, self.posture, self.places
        other.gap, other.person = self.gap, self.person
        return other

    def follow(self, pose: np.ndarray, dt: float) -> None:
        self.places.append(pose[:3, 3])
        self.pose, self._number = pose, self._number + 1
        self.posture = np.full(32, self._sways * np.sin(self._number / 20))

    def rest(self, pose: np.ndarray) -> bool:
        self.posture = np.zeros(32)
        return True

    def carry(self, pose: np.ndarray) -> bool:
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
    assert people_unit.follows_of(unit) is follows  # type: ignore[arg-type]
    steps = np.linalg.norm(np.diff(home.places[:200], axis=0), axis=1)
    assert steps.max() < 0.16 * 0.02 + 1e-9, "at 0.15 m/s, no jumps"
    home.gap = 0.02
    assert people_unit.follows_of(unit) is False, "left behind where there is a rest"
    monkeypatch.setattr(Restless, "carry", lambda self, pose: False)
    assert people_unit.follows_of(unit) is None, "out of reach"  # type: ignore[arg-type]
    # Nor where the object is left alone: it is the last second that counts, not the best moment.
    swings = np.radians(sways_deg) * np.sin(np.arange(1000) / 20)
    trace = SimpleNamespace(postures=[np.full(32, angle) for angle in swings])
    rest = home.copy()
    rest.rest(rest.pose)
    found = people_way.at_rest(trace, home, rest, 0.02)  # type: ignore[arg-type]
    assert (found["from_rest_deg"] < people_unit.APART_DEG) is follows
    home.person.kind = "pushed"
    found = people_way.at_rest(trace, home, rest, 0.02)  # type: ignore[arg-type]
    assert found["from_rest_deg"] < people_unit.APART_DEG, "who is pushed rests in between"


def test_tables_say_the_same_as_figures() -> None:
    units = [unit(5, 2), unit(6, 3)]
    row = table_of(units, ["ergoqp"])[0]
    assert row[:2] == ("ergoqp", "2.50")
    text = markdown_of(units, ["still", "rule", "ergoqp"])
    assert "| still | 5.50 |" in text
    assert "| looking | 5.5 / 3.0 / 3.0 / 2.5 / 2.5 |" in text
    assert "<svg" in means_chart(units)
