"""A CasADi QP plugin as the plain function that the step calls."""

from __future__ import annotations

from typing import Any

import casadi as ca


def plugin_function(plugin: str, n: int, m: int, options: dict[str, Any]) -> ca.Function:
    """Return ``(h, g, a, lba, uba, lbx, ubx) -> (x, lam_a, lam_x)`` of a CasADi conic plugin.

    The plugin does not raise on failure.
    """
    shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
    qp = ca.conic("qp", plugin, shapes, {"error_on_fail": False, **options})
    names = ["h", "g", "a", "lba", "uba", "lbx", "ubx"]
    sizes = [(n, n), (n, 1), (m, n), (m, 1), (m, 1), (n, 1), (n, 1)]
    inputs = [ca.MX.sym(name, *size) for name, size in zip(names, sizes, strict=True)]
    answer = qp(**dict(zip(names, inputs, strict=True)))
    return ca.Function(plugin, inputs, [answer["x"], answer["lam_a"], answer["lam_x"]])
