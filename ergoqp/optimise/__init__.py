"""The best place of the object, offline: many starts of one nonlinear program, each verified on the person and the sheet."""

from ergoqp.optimise.optimum import Optimum, Trial

__all__ = ["Optimum", "Trial"]
