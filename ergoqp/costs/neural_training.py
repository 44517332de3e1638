"""Training of `ergoqp.costs.neural.Neural`: forward, backward and Adam in single precision, a few products per update."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Network = dict[str, NDArray]
"""``places`` and ``sharpness`` of the soft steps (d, k); ``W1``, ``b1``, ... of the dense layers, inputs first."""

_WARM_UP = 300
"""Updates over which the rate grows to its full size."""

_FIRST, _SECOND, _TINY = 0.9, 0.999, 1e-8
"""Adam's memory of the gradient and of its square, and what keeps the division defined (Kingma and Ba, 2015)."""


def train(
    points: NDArray,
    classes: NDArray,
    count: int,
    steps: int,
    hidden: Sequence[int],
    epochs: int,
    batch: int,
    rate: float,
    seed: int,
    progress: Callable[[float], None] | None = None,
) -> Network:
    """Return the parameters of a network that gives each class a probability, trained by cross-entropy.

    Args:
        points: inputs (n, d).
        classes: number of the class of each (n,), from 0.
        count: how many classes there are.
        steps: soft steps per input.
        hidden: sizes of the dense layers.
        epochs: passes over the data.
        batch: points per update.
        rate: largest step of Adam; it falls to zero along half a cosine.
        seed: of start and order.
        progress: told the share that is done.
    """
    rng = np.random.default_rng(seed)
    inputs = points.astype(np.float32)
    net = _start(inputs, count, steps, hidden, rng)
    mean = {name: np.zeros_like(values) for name, values in net.items()}
    square = {name: np.zeros_like(values) for name, values in net.items()}
    batch = min(batch, len(inputs))
    updates, done = epochs * (len(inputs) // batch), 0
    for _ in range(epochs):
        order = rng.permutation(len(inputs))
        for first in range(0, len(order) - batch + 1, batch):
            rows = order[first : first + batch]
            slopes = _slopes(net, inputs[rows], classes[rows])
            done += 1
            pace = rate * min(1.0, done / _WARM_UP) * 0.5 * (1 + np.cos(np.pi * done / updates))
            for name, slope in slopes.items():
                mean[name] += np.float32(1 - _FIRST) * (slope - mean[name])
                square[name] += np.float32(1 - _SECOND) * (slope * slope - square[name])
                size = np.sqrt(square[name] / np.float32(1 - _SECOND**done)) + np.float32(_TINY)
                net[name] -= np.float32(pace / (1 - _FIRST**done)) * mean[name] / size
            if progress is not None and done % 100 == 0:
                progress(done / updates)
    net["sharpness"] = np.exp(net["sharpness"])
    return net


def _start(inputs: NDArray, count: int, steps: int, hidden: Sequence[int], rng: np.random.Generator) -> Network:
    """Steps evenly spread over each input's range, each as wide as their distance; small random dense layers.

    The logarithm of the sharpness is what is trained, so that it stays positive.
    """
    low, high = inputs.min(axis=0).astype(float), inputs.max(axis=0).astype(float)
    wide = np.maximum(high - low, 1e-6)
    places = low[:, np.newaxis] + wide[:, np.newaxis] * np.arange(1, steps + 1) / (steps + 1)
    net = {"places": places, "sharpness": np.log(np.repeat(2 * (steps + 1) / wide[:, np.newaxis], steps, axis=1))}
    sizes = [places.size, *hidden, count]
    for layer, (rows, columns) in enumerate(pairwise(sizes), start=1):
        net[f"W{layer}"] = rng.normal(size=(rows, columns)) / np.sqrt(rows)
        net[f"b{layer}"] = np.zeros(columns)
    return {name: values.astype(np.float32) for name, values in net.items()}


def _slopes(net: Network, inputs: NDArray, classes: NDArray) -> Network:
    """Return the derivative of the mean cross-entropy by every parameter."""
    layers = sum(name.startswith("W") for name in net)
    sharpness = np.exp(net["sharpness"])
    argument = (inputs[:, :, np.newaxis] - net["places"]) * sharpness
    outputs = [np.tanh(argument).reshape(len(inputs), -1)]
    for layer in range(1, layers):
        outputs.append(np.tanh(outputs[-1] @ net[f"W{layer}"] + net[f"b{layer}"]))
    z = outputs[-1] @ net[f"W{layers}"] + net[f"b{layers}"]
    back = np.exp(z - z.max(axis=1, keepdims=True))
    back /= back.sum(axis=1, keepdims=True)
    back[np.arange(len(back)), classes] -= 1
    back /= np.float32(len(back))
    slopes: Network = {}
    for layer in range(layers, 0, -1):
        output = outputs[layer - 1]
        slopes[f"W{layer}"], slopes[f"b{layer}"] = output.T @ back, back.sum(axis=0)
        back = (back @ net[f"W{layer}"].T) * (1 - output * output)
    back = back.reshape(argument.shape)
    slopes["places"] = -back.sum(axis=0) * sharpness
    slopes["sharpness"] = (back * argument).sum(axis=0)
    return slopes
