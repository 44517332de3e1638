"""The person, drawn."""
