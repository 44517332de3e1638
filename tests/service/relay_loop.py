"""A loop in Python with a relay, in a process of its own: it says what it gave the relay."""

from __future__ import annotations

import json
import sys
import time

import numpy as np

import ergoqp


def main(address: str, relay: str, dt: float, begun: str) -> None:
    """Step for ever; report that the robot stands where the relay says so."""
    posture = np.array(json.loads(begun))
    client = ergoqp.Client(address, relay=relay, timeout=0.9 * dt)
    resets = 0
    while True:
        start = time.perf_counter()
        step = client.step(posture)
        posture = posture + dt * step.posture_rate
        told = {
            "fresh": step.fresh,
            "reason": step.reason,
            "twist": step.twist.tolist(),
            "stop": client.stop().tolist(),
            "resets": resets,
        }
        print(json.dumps(told), flush=True)
        if client.waits and client.relay_stands:
            client.reset()
            resets += 1
        time.sleep(max(0.0, dt - (time.perf_counter() - start)))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4])
