"""Markers whose unit is stated, found out, or wrong."""

import numpy as np
import pytest

from benchmarks.made_markers import markers_of
from benchmarks.made_motions import BODY
from ergoqp.errors import RecordingError
from ergoqp.mocap import fit_postures

NAMES, PLACES = markers_of(BODY, np.tile([0.0, 0.0, 0.9, 0.0], (60, 1)), np.zeros((60, 32)))


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.001, 0.0254])
def test_the_unit_is_found(unit: float):
    recording = fit_postures(NAMES, PLACES / unit, 60.0, unit_to_m=None)
    assert recording.person.stature == pytest.approx(BODY.stature, abs=0.02)
    assert any(f"taken as {unit:g} m" in each for each in recording.assumptions)


@pytest.mark.parametrize("unit", [0.001, 0.0254, 100.0])
def test_a_unit_that_cannot_be(unit: float):
    wrong = rf"with a unit of {unit:g} m the ASIS markers .* allowed 0.15 to 0.4 m"
    with pytest.raises(RecordingError, match=wrong):
        fit_postures(NAMES, PLACES, 60.0, unit_to_m=unit)


def test_units_that_are_mixed_are_refused():
    places = PLACES.copy()
    places[:, [NAMES.index(name) for name in ("RKNE", "LKNE", "RELB")]] *= 0.001
    with pytest.raises(RecordingError, match="allowed markers where their names say"):
        fit_postures(NAMES, places, 60.0)


def test_a_lower_body_cannot_be_scored():
    legs = [i for i, name in enumerate(NAMES) if name[1:] in ("ASI", "PSI", "THI", "KNE", "ANK")]
    legs += [i for i, name in enumerate(NAMES) if name[1:] in ("TIB", "TOE")]
    with pytest.raises(RecordingError, match="the upper trunk cannot be placed"):
        fit_postures([NAMES[i] for i in legs], PLACES[:, legs], 60.0)
