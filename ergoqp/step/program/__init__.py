"""The QP of a step: what it minimises, its rows and their bounds, and its answer in passes."""
