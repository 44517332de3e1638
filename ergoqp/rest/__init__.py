"""The model of rest: people like the controller's model, and where they come to rest."""
