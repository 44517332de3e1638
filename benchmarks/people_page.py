"""The page of `benchmarks.people`: who is helped by what, and the worst ten runs as replays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.people_draw import draw_unit, model_optimum, places_to_try
from benchmarks.people_figures import Numbers, best_of, end_of, figures_of, table_of
from ergoqp.files.atomic import write_text_atomic
from ergoqp.report.charts import svg
from ergoqp.report.charts.axes import WIDTH, Scale, time_axis
from ergoqp.report.page import Headline, Page, PageTable, Picture, Section, write_page
from ergoqp.report.run_page import write_run_page
from ergoqp.simulation.simulate import simulate

WORST = 10
HEAD = (
    "way",
    "end",
    "at best",
    "at 20 s",
    "above",
    "> still",
    "> rule",
    "gain",
    "own gain",
    "moves on",
    "rest, s",
    "path, m",
)
_DOTS = (("still", "missed"), ("rule", "level2"), ("ergoqp", "spot"), ("best", "hollow"))


def write_people_page(found: Sequence[Numbers], ways: Sequence[str], folder: Path) -> Path:
    """Write ``report.html`` and the replays into a folder, and return its path."""
    drawn = [unit for unit in found if unit["drawn"]]
    kinds, problems = (list(dict.fromkeys(unit[what] for unit in drawn)) for what in _GROUPS)
    of = {way: figures_of(drawn, way) for way in ways}
    best = float(np.mean([best_of(unit) for unit in drawn]))
    means = [
        ("left alone", of["still"]["mean_end"]),
        ("rule of thumb", of["rule"]["mean_end"]),
        ("ergoqp, by descent", of["descent"]["mean_end"]),
        ("ergoqp, trying places", of["ergoqp"]["mean_end"]),
        ("best", best),
    ]
    page = Page(
        title="People of other kinds",
        subtitle=f"Mean REBA at rest over {len(drawn)} starts, each with a person of its own.",
        headlines=[Headline(name, f"{value:.2f}", -1, "points") for name, value in means],
        change="",
        facts=[("kinds", ", ".join(kinds)), ("problems", ", ".join(problems))],
        replay="",
        replay_note="",
        figures=[],
        sections=[
            Section(
                "Every way of moving the object",
                "ergoqp tries places and keeps what measures best (--seek); guided is drawn to the"
                " optimum of its own model of the person (--guide best); descent goes as it comes."
                " The rules put the object at elbow"
                " height, 0.40 m ahead, level. End:"
                " mean REBA at rest; at best: share that ends there, and had it been left after"
                " 20 s; above: points above best; > still, > rule: shares that end higher, so"
                " worse; gain: points below the rule, own gain: below that with the very person's"
                " elbow; moves on: share whose object"
                " moves to the end; rest: median time of the first."
                " An end where the person has no rest counts as no better than the start and, where"
                " shares are compared, as worse than any rest. Best is the lower one of what a"
                " search found before and of what any way ended with. Rules and open loop are told"
                " in advance how far the person comes along.",
                tables=[_table(HEAD, table_of(drawn, ways))],
            ),
            Section(
                "Per kind of person and per problem",
                "Mean REBA at rest: left alone, by the rule, by ergoqp's descent and by the"
                " places that it tries, and the best that is known for these people from their"
                " starts.",
                pictures=[Picture.of(lambda width: means_chart(drawn, width))],
                tables=[_matrix(drawn, kinds, problems)],
            ),
            _worst(drawn, folder),
        ],
    )
    path = folder / "report.html"
    write_page(page, path)
    write_text_atomic(folder / "tables.md", markdown_of(drawn, ways))
    return path


_GROUPS = ("kind", "problem")


def means_chart(drawn: Sequence[Numbers], width: float = WIDTH) -> str:
    """Return the mean ends of every kind and problem as dots on a line each."""
    rows = [
        (what, name, [unit for unit in drawn if unit[what] == name])
        for what in _GROUPS
        for name in dict.fromkeys(unit[what] for unit in drawn)
    ]
    narrow = width < WIDTH
    left, top, high = 110.0, 52.0 if narrow else 34.0, 26.0
    bottom = top + high * len(rows)
    scale = Scale(1.0, 8.0, left, width - 20)
    drawing = time_axis(scale, top - 8, bottom, "mean REBA at rest, points")
    for number, (name, style) in enumerate(_DOTS):
        x, y = left + 120 * (number % 2 if narrow else number), 12 + 20 * (narrow and number > 1)
        drawing += [
            svg.element("circle", cx=x, cy=y, r=5, class_=style),
            svg.text(name.replace("still", "left alone"), x + 12, y + 4, class_="label"),
        ]
    for number, (_, name, units) in enumerate(rows):
        y = top + high * (number + 0.5)
        means = [float(np.mean([_mean_of(unit, way) for unit in units])) for way, _ in _DOTS]
        ends = scale.at(min(means)), scale.at(max(means))
        drawing += [
            svg.text(name, left - 14, y + 4, class_="strong end"),
            svg.element("line", x1=ends[0], x2=ends[1], y1=y, y2=y, class_="link"),
        ]
        for mean, (_, style) in zip(means, _DOTS, strict=True):
            drawing.append(svg.element("circle", cx=scale.at(mean), cy=y, r=5.5, class_=style))
    said = "Mean REBA at rest per kind of person and per problem."
    return svg.picture(drawing, width, bottom + 42, said, said)


def _mean_of(unit: Numbers, way: str) -> float:
    return float(best_of(unit)) if way == "best" else end_of(unit, unit["ways"][way])


def _matrix(drawn: Sequence[Numbers], kinds: Sequence[str], problems: Sequence[str]) -> PageTable:
    """Return a table per kind and problem: still / rule / descent / ergoqp / best."""

    def cell(kind: str, problem: str | None) -> str:
        units = [u for u in drawn if u["kind"] == kind and problem in (u["problem"], None)]
        if not units:
            return "–"
        ways = ("still", "rule", "descent", "ergoqp", "best")
        return " / ".join(f"{np.mean([_mean_of(unit, way) for unit in units]):.1f}" for way in ways)

    rows = [(kind, *(cell(kind, name) for name in (*problems, None))) for kind in kinds]
    return _table(("kind", *problems, "all"), rows)


def _table(head: Sequence[str], rows: Sequence[tuple[str, ...]]) -> PageTable:
    return PageTable(head, rows, numeric=tuple(range(1, len(head))))


def _worst(drawn: Sequence[Numbers], folder: Path) -> Section:
    """Write the replays of the worst runs, and return the section that links to them."""

    def badness(unit: Numbers) -> tuple[float, float, float]:
        way = unit["ways"]["ergoqp"]
        end, rule = end_of(unit, way), end_of(unit, unit["ways"]["rule"])
        return end - best_of(unit), end - rule, way["peak"] - unit["still"]

    links: list[tuple[str, str]] = []
    for number, unit in enumerate(sorted(drawn, key=badness, reverse=True)[:WORST], start=1):
        name = f"worst_{number:02d}_{unit['kind']}_{unit['problem']}_{unit['seed']}"
        _write_replay(unit, folder / f"{name}.html")
        ways = unit["ways"]
        rests = "" if ways["ergoqp"]["holds"] else " without a rest"
        links.append(
            (
                f"{name}.html",
                f"{unit['kind']} in {unit['problem']}, seed {unit['seed']}: {unit['still']} to"
                f" {ways['ergoqp']['end']}{rests}; by the rule {ways['rule']['end']},"
                f" best {best_of(unit)}",
            )
        )
    return Section(
        f"The worst {len(links)} runs",
        "By how far ergoqp ends above the best, then above the rule, then how high it gets.",
        links=links,
    )


def _write_replay(numbers: dict[str, Any], path: Path) -> None:
    """Run a unit's loop again, with everything that a report shows."""
    unit = draw_unit(numbers["kind"], numbers["problem"], numbers["seed"]).unit
    if unit is None:
        raise RuntimeError(f"{path.name}: the start that was drawn before is not drawn again")
    seconds = numbers["ways"]["ergoqp"]["seconds"]
    places = places_to_try(unit.problem, model_optimum(numbers["problem"]))
    run = simulate(unit.problem, unit.start, seconds, unit.seed, seek=places)
    write_run_page(run, path)


def markdown_of(drawn: Sequence[Numbers], ways: Sequence[str]) -> str:
    """Return the page's tables for a text: every way, then every kind and problem."""
    kinds, problems = (list(dict.fromkeys(unit[what] for unit in drawn)) for what in _GROUPS)
    matrix = _matrix(drawn, kinds, problems)
    tables = [(HEAD, table_of(drawn, ways)), (matrix.head, matrix.rows)]
    return "\n".join(
        "\n".join(
            [
                f"| {' | '.join(head)} |",
                f"|{'---|' * len(head)}",
                *(f"| {' | '.join(row)} |" for row in rows),
                "",
            ]
        )
        for head, rows in tables
    )
