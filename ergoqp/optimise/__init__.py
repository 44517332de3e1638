"""The best place for the object, offline: for one person, for a population, for a group that shares one place."""
