"""The best place of the object, offline: for one person, for a population or for a group.

A group shares one fixed place.

One person: `ergoqp.optimise`, many starts of one nonlinear program, each verified on the person and
the sheet. A group: `ergoqp.placing.group.optimise.best_for_group`. Everybody of a population:
`ergoqp.placing.population.best_of_population`.
"""
