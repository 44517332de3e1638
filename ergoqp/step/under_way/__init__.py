"""The motion that is under way already: what was planned and sent, and where the object lands."""
