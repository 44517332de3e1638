"""The guide: a place that the object is drawn to. Its term in the objective, and its trial."""
