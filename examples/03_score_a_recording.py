"""Score a motion-capture recording by REBA, and say why its worst moment is bad.

    python examples/03_score_a_recording.py take.bvh

Without a file, the project writes a recording of its own and scores that.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import ergoqp
from ergoqp import reba
from ergoqp.mocap.demo_recording import demo_recording

if len(sys.argv) > 1:
    recording = ergoqp.load_recording(sys.argv[1])
else:
    with tempfile.TemporaryDirectory() as folder:
        recording = ergoqp.load_recording(demo_recording(Path(folder) / "demo.bvh"))

for sentence in recording.assumptions:
    print("assumed:", sentence)

# What joint angles cannot tell is an explicit input, never guessed.
assessment = reba.assess(recording.postures, load_kg=1.5, coupling=1)

for level, name in enumerate(reba.ACTION_LEVELS):
    print(f"{name:<11} {100 * np.mean(assessment.band == level):5.1f} % of the time")

worst = int(np.argmax(assessment.final))
print(f"worst: REBA {assessment.final[worst]} at {recording.time[worst]:.2f} s")
for sentence in assessment.reasons(worst):
    print("  ", sentence)
