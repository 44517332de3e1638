"""``ergoqp fit boundary``: the region of the data, as a limit for problem files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

from ergoqp.cli.commands.common import make_folder
from ergoqp.cli.commands.fit import check_extra, load_data, read_settings
from ergoqp.cli.commands.screen import console, working
from ergoqp.learning.one_class import OneClass


def fit_boundary(
    source: str,
    joints: str,
    per_score: int,
    seed: int,
    folds: int,
    settings: Sequence[str],
    out: Path | None,
) -> None:
    """Fit a one-class SVM, print how many unseen points are inside, and write the model.

    Args:
        source: as for `ergoqp.cli.commands.fit.fit`.
        joints: likewise.
        per_score: likewise.
        seed: seed of data and folds.
        folds: number of folds of the cross-validation, at least 2.
        settings: ``name=value`` of `OneClass.fit`.
        out: folder of the results.

    Raises:
        ErgoqpError: if an argument cannot be used.
    """
    check_extra("sklearn")
    options = read_settings(OneClass.fit, settings)
    with working("data") as done:
        data = load_data(source, joints, per_score, seed, folds, done)
    screen = console()
    screen.print(Text(f"{len(data)} points of {len(data.coordinates)} coordinates: {data.source}"))
    fold = np.random.default_rng(seed).permutation(len(data)) % folds
    inside = []
    with working(f"cross-validation, {folds} folds") as done:
        for number in range(folds):
            model = OneClass.fit(data.points[fold != number], data.coordinates, **options)
            inside.append(float((model.margin(data.points[fold == number]) >= 0).mean()))
            done((number + 1) / folds)
    model = OneClass.fit(data.points, data.coordinates, **options)
    table = Table(title="boundary: points inside", title_justify="left")
    table.add_column("")
    table.add_column("inside", justify="right")
    table.add_row("points it was fitted to", f"{(model.margin(data.points) >= 0).mean():.1%}")
    table.add_row("unseen points", f"{np.mean(inside):.1%} ± {np.std(inside):.1%}")
    path = make_folder(out, "fit-boundary") / "boundary.npz"
    model.save(path)
    screen.print(table)
    screen.print(Text(f"{len(model.weights)} kernels, {path.stat().st_size / 1e3:.0f} kB"))
    screen.print(Text(f"{path.name:<24} {path}"), soft_wrap=True)
