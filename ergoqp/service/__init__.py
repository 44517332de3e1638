"""The control step for other processes: the service, its clients, and what they tell each other."""
