"""The best place of the object, offline: for one person, a population or a group.

A group shares one fixed place. One person: `ergoqp.optimise`. It solves one nonlinear program from
many starts and verifies each end with the person and the sheet. A group:
`ergoqp.lab.group.best_for_group`. Everybody of a population:
`ergoqp.lab.population.best_of_population`.
"""
