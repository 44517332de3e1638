"""Value and slope of a network as CasADi expressions, see `ergoqp.learning.network`."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ergoqp.learning.network import Network, depth


def soft_steps(net: Network, x: ca.MX) -> ca.MX:
    """Return the soft steps of the first layer for k columns of inputs (d, k)."""
    places, sharpness = net["places"], net["sharpness"]
    shift = ca.DM((places * sharpness).ravel())
    return ca.tanh(ca.MX(_blocks(sharpness[..., np.newaxis])) @ x - ca.repmat(shift, 1, x.shape[1]))


def dense_layers(net: Network, steps: ca.MX) -> list[ca.MX]:
    """Return the curves that are made from the steps, and the output of each dense layer."""
    values = [ca.MX(_blocks(net["mixing"].transpose(0, 2, 1))) @ steps]
    for layer in range(1, depth(net) + 1):
        bias = ca.repmat(ca.DM(net[f"b{layer}"]), 1, steps.shape[1])
        z = ca.MX(ca.DM(net[f"W{layer}"].T)) @ values[-1] + bias
        values.append(z if layer == depth(net) else ca.tanh(z))
    return values


def led_back(net: Network, steps: ca.MX, values: list[ca.MX], slope: ca.MX) -> ca.MX:
    """Return the slope with respect to the inputs (d,), from that with respect to the last layer.

    Args:
        net: the network.
        steps: result of `soft_steps`.
        values: result of `dense_layers`.
        slope: slope with respect to the last of `values`.
    """
    for layer in range(depth(net), 0, -1):
        slope = ca.MX(ca.DM(net[f"W{layer}"])) @ slope
        if layer > 1:
            slope *= 1 - values[layer - 1] ** 2
    return ca.MX(_blocks(net["sharpness"][:, np.newaxis])) @ (
        (ca.MX(_blocks(net["mixing"])) @ slope) * (1 - steps**2)
    )


def _blocks(blocks: NDArray) -> ca.DM:
    """Return the sparse matrix (d a, d b) with the diagonal blocks (d, a, b)."""
    count, rows, columns = blocks.shape
    full = np.zeros((count, rows, count, columns))
    full[np.arange(count), :, np.arange(count), :] = blocks
    return ca.sparsify(ca.DM(full.reshape(count * rows, count * columns)))
