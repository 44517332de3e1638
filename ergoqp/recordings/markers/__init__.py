"""From markers on the skin to the joint centres below it."""
