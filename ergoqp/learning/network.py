"""The network of `ergoqp.costs.neural.Neural`: layers, and single-precision training by Adam."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice, pairwise

import numpy as np
from numpy.typing import NDArray

Network = dict[str, NDArray]
"""Parameters of a network by name.

``places`` and ``sharpness`` (d, k): the soft steps of each input. ``mixing`` (d, k, m): makes
m curves of each input from its steps. ``W1``, ``b1``, ...: the dense layers, inputs first, the
last one to the classes.
"""

Batches = Iterator[tuple[NDArray, NDArray]]
"""Points (n, d) and the numbers of their classes (n,), counted from 0, for one update each."""

_WARM_UP = 300
"""Number of updates over which the rate grows to its full size."""

_FIRST, _SECOND, _TINY = 0.9, 0.999, 1e-8
"""Adam's decay rates of the gradient and its square, and the term that avoids division by zero.

The values are those of Kingma and Ba, 2015.
"""


def depth(net: Network) -> int:
    """Return the number of dense layers."""
    return sum(name.startswith("W") for name in net)


def start(
    points: NDArray,
    count: int,
    steps: int,
    curves: int,
    hidden: Sequence[int],
    rng: np.random.Generator,
) -> Network:
    """Return an untrained network.

    Its steps are evenly spread over the range of each input. All weights are small and random.

    Args:
        points: inputs (n, d), for their ranges.
        count: number of classes.
        steps: number of soft steps per input.
        curves: number of curves made from the steps of each input.
        hidden: sizes of the dense layers.
        rng: source of randomness.
    """
    low, high = points.min(axis=0).astype(float), points.max(axis=0).astype(float)
    wide = np.maximum(high - low, 1e-6)[:, np.newaxis]
    net = {
        "places": low[:, np.newaxis] + wide * np.arange(1, steps + 1) / (steps + 1),
        "sharpness": np.repeat(2 * (steps + 1) / wide, steps, axis=1),
        "mixing": rng.normal(size=(len(wide), steps, curves)) / np.sqrt(steps),
    }
    for layer, (rows, columns) in enumerate(
        pairwise([len(wide) * curves, *hidden, count]), start=1
    ):
        net[f"W{layer}"] = rng.normal(size=(rows, columns)) / np.sqrt(rows)
        net[f"b{layer}"] = np.zeros(columns)
    return net


def shuffled(points: NDArray, classes: NDArray, batch: int, rng: np.random.Generator) -> Batches:
    """Yield batches of the same data endlessly, in a new order in each pass."""
    while True:
        order = rng.permutation(len(points))
        for first in range(0, len(order) - batch + 1, batch):
            rows = order[first : first + batch]
            yield points[rows], classes[rows]


def fresh(blocks: Iterator[tuple[NDArray, NDArray]], labels: NDArray, batch: int) -> Batches:
    """Yield batches from blocks of points and labels, each used once. `labels` are the classes."""
    for points, given in blocks:
        # The rest of a block is dropped, because new points are cheap.
        classes = np.searchsorted(labels, given)
        for first in range(0, len(points) - batch + 1, batch):
            yield points[first : first + batch], classes[first : first + batch]


def train(
    net: Network,
    batches: Batches,
    updates: int,
    rate: float,
    decay: float = 0.0,
    progress: Callable[[float], None] | None = None,
) -> Network:
    """Return the network with parameters trained by cross-entropy, in float32.

    Args:
        net: network from `start`.
        batches: at least as many as updates.
        updates: number of updates.
        rate: largest step of Adam; it grows from zero and falls to zero along half a cosine.
        decay: weight decay, as a share of the rate (Loshchilov and Hutter, 2019); steps have
            none.
        progress: called with the share that is done.
    """
    # All parameters are in one array, so that an update is a few operations. The names are
    # views of it. The logarithm of the sharpness is trained, so the sharpness stays positive.
    begun = {**net, "sharpness": np.log(net["sharpness"])}
    row = np.concatenate([values.ravel() for values in begun.values()]).astype(np.float32)
    ends = np.cumsum([values.size for values in begun.values()])
    views = {
        n: v.reshape(begun[n].shape) for n, v in zip(begun, np.split(row, ends[:-1]), strict=True)
    }
    mean, square = np.zeros_like(row), np.zeros_like(row)
    weights = row[begun["places"].size + begun["sharpness"].size :]
    for done, (points, classes) in enumerate(islice(batches, updates), start=1):
        current = {**views, "sharpness": np.exp(views["sharpness"])}
        slopes = _slopes(current, points.astype(np.float32), classes)
        slope = np.concatenate([slopes[name].ravel() for name in views])
        pace = rate * min(1.0, done / _WARM_UP) * 0.5 * (1 + np.cos(np.pi * done / updates))
        mean += np.float32(1 - _FIRST) * (slope - mean)
        square += np.float32(1 - _SECOND) * (slope * slope - square)
        size = np.sqrt(square / np.float32(1 - _SECOND**done)) + np.float32(_TINY)
        row -= np.float32(pace / (1 - _FIRST**done)) * mean / size
        weights *= np.float32(1 - pace * decay)
        if progress is not None and (done % 100 == 0 or done == updates):
            progress(done / updates)
    return {**views, "sharpness": np.exp(views["sharpness"])}


def steps_of(net: Network, points: NDArray) -> NDArray:
    """Return the soft steps (d, n, k) of points (n, d)."""
    return np.tanh(
        (points.T[:, :, np.newaxis] - net["places"][:, np.newaxis])
        * net["sharpness"][:, np.newaxis]
    )


def layers_of(net: Network, steps: NDArray) -> list[NDArray]:
    """Return the input of each dense layer, and at the end the log class weights (n, classes)."""
    curves = np.matmul(steps, net["mixing"])
    values = [np.ascontiguousarray(curves.transpose(1, 0, 2)).reshape(steps.shape[1], -1)]
    for layer in range(1, depth(net) + 1):
        z = values[-1] @ net[f"W{layer}"] + net[f"b{layer}"]
        values.append(z if layer == depth(net) else np.tanh(z, out=z))
    return values


def shares_of(z: NDArray) -> NDArray:
    """Return the probability (n, classes) of each class from the log class weights."""
    weights = np.exp(z - z.max(axis=1, keepdims=True))
    return weights / weights.sum(axis=1, keepdims=True)


def _slopes(net: Network, points: NDArray, classes: NDArray) -> Network:
    """Return the derivative of the mean cross-entropy with respect to every parameter.

    For the sharpness it is the derivative with respect to the logarithm.
    """
    steps = steps_of(net, points)
    values = layers_of(net, steps)
    back = shares_of(values.pop())
    back[np.arange(len(back)), classes] -= 1
    back /= np.float32(len(back))
    slopes: Network = {}
    for layer in range(depth(net), 0, -1):
        value = values[layer - 1]
        slopes[f"W{layer}"], slopes[f"b{layer}"] = value.T @ back, back.sum(axis=0)
        back = back @ net[f"W{layer}"].T
        if layer > 1:
            back *= 1 - value * value
    joints, _, curves = net["mixing"].shape
    back = np.ascontiguousarray(back.reshape(len(points), joints, curves).transpose(1, 0, 2))
    slopes["mixing"] = np.matmul(steps.transpose(0, 2, 1), back)
    back = np.matmul(back, net["mixing"].transpose(0, 2, 1))
    back *= 1 - steps * steps
    # The argument of a step is a (x - c). Its derivatives with respect to c and log a are -a
    # and a (x - c), summed over the points.
    by_place = back.sum(axis=1) * net["sharpness"]
    by_input = np.matmul(points.T[:, np.newaxis], back)[:, 0] * net["sharpness"]
    slopes["places"], slopes["sharpness"] = -by_place, by_input - net["places"] * by_place
    return slopes
