"""Postures for the tests of the sheet."""

import numpy as np

from ergoqp import reba
from ergoqp.joints import INDEX, LOWER, UPPER


def posture(**degrees):
    """Return one posture from angles by joint name [deg]."""
    found = np.zeros(32)
    for name, value in degrees.items():
        found[INDEX[name]] = np.radians(value)
    return found


def score(name, method=None, **degrees):
    """Return one segment's score, or ``final``."""
    options = {key: degrees.pop(key) for key in list(degrees) if key not in INDEX}
    result = reba.assess(posture(**degrees), method, **options)
    return int(result.final[0] if name == "final" else result.segments[name][0])


def random_postures(count, seed=0):
    """Return postures half of which are near upright, so that low scores occur too."""
    rng = np.random.default_rng(seed)
    return rng.uniform(LOWER, UPPER, (count, 32)) * rng.choice([0.1, 0.3, 1.0], (count, 1))
