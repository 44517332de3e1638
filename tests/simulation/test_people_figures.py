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
    usual = {"still": way(start), "rule": way(3), "ergoqp": way(best)}
    return {"still": start, "best": best, "kind": "looking", "problem": "desk"} | {
        "ways": usual | ways
    }


def test_figures_are_what_their_names_say() -> None:
    units = [
        unit(5, 2, ergoqp=way(2, early=4, peak=6.5)),
        unit(5, 2, ergoqp=way(1), rule=way(2)),
        unit(6, 3, ergoqp=way(6, rests=False, first_rest=None, peak=7.0), still=way(5)),
        unit(6, 2, ergoqp=way(7, holds=False, peak=7.5, force=[1.0, 5.0, 9.0], slips=2, fell=True)),
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
    assert found["lets_go"] == 0.25
    assert (found["force_median_n"], found["force_peak_n"]) == (1.0, 9.0)
    assert (found["slips"], found["falls"]) == (0.5, 0.25)
    assert figures_of(units, "rule")["gain_over_rule"] == 0.0
    assert "force_peak_n" not in figures_of(units, "rule")


def test_a_trace_is_measured_as_is_said() -> None:
    problem = SimpleNamespace(
        dt=0.01,
        twist_limit=SimpleNamespace(speed=np.ones(6)),
        assess=lambda postures: SimpleNamespace(final=postures[:, 0]),
    )
    trace = Trace()
    for number in range(800):
        # Moves for 2 s, rests for 3 s, moves for the last 3 s; a blip of half a second in between.
        moves = number < 200 or number >= 500
        trace.twists.append(np.array([0.1 if moves else 0.0, 0, 0, 0, 0, 0]))
        trace.postures.append(np.full(32, 9 if 300 <= number < 340 else 5))
        trace.forces.append(np.full(6, np.nan))
        trace.slips.append(0)
        trace.unbalanced.append(False)
    found = people_way.of_trace(problem, trace)  # type: ignore[arg-type]
    assert found["first_rest"] == pytest.approx(2.0)
    assert not found["rests"]
    assert found["peak"] == 5.0
    assert found["path"] == pytest.approx(0.5)
    assert found["force"] is None
    trace.postures[300:500] = [np.full(32, 9)] * 200
    found = people_way.of_trace(problem, trace)  # type: ignore[arg-type]
    assert found["peak"] == 9.0


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
    assert one is not None
    assert same is not None
    np.testing.assert_array_equal(one.start.posture, same.start.posture)
    assert one.still >= one.best + people_unit.ABOVE
    assert one.still == one.problem.assess(one.start.posture).final[0]
    still = people_unit.way_of(one, "still")
    assert still["end"] == one.still
    assert still["path"] == 0.0
    assert still["from_rest_deg"] < 2.0


def test_tables_say_the_same_as_figures() -> None:
    units = [unit(5, 2), unit(6, 3)]
    row = table_of(units, ["ergoqp"])[0]
    assert row[:2] == ("ergoqp", "2.50")
    text = markdown_of(units, ["still", "rule", "ergoqp"])
    assert "| still | 5.50 |" in text
    assert "| looking | 5.5 / 3.0 / 2.5 / 2.5 |" in text
    assert "<svg" in means_chart(units)
