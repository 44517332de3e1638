"""A QP solver: CasADi's own, started once more where it ended."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

_PARTS = ("h", "g", "a", "lba", "uba", "lbx", "ubx")


class QrqpTwice:
    """An active-set method by QR; the second run mends what the first left over."""

    name: ClassVar[str] = "qrqp_twice"

    def function(self, n: int, m: int) -> ca.Function:
        """Return ``(h, g, a, lba, uba, lbx, ubx) -> (x, lam_a, lam_x)``; it never raises."""
        sizes = ((n, n), (n, 1), (m, n), (m, 1), (m, 1), (n, 1), (n, 1))
        silent = {"print_iter": False, "print_header": False, "print_info": False}
        shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
        solve = ca.conic("solve", "qrqp", shapes, {"error_on_fail": False, **silent})
        given = {name: ca.MX.sym(name, *size) for name, size in zip(_PARTS, sizes, strict=True)}
        first = solve(**given)
        start = {"x0": first["x"], "lam_a0": first["lam_a"], "lam_x0": first["lam_x"]}
        again = solve(**given, **start)
        return ca.Function("twice", [*given.values()], [again[x] for x in ("x", "lam_a", "lam_x")])
