"""The command ``ergoqp``."""
