"""People who are never the controller's own model, drawn at random."""
