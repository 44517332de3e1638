"""The control step: `ergoqp.step.function` is its table of contents; `Stepper` is a loop's."""
