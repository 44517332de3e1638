"""The control step: `ergoqp.step.function` puts its parts together; `Stepper` runs a loop."""
