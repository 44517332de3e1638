"""Labelled postures: drawn, streamed, kept on disk, read from tables; and how well a cost predicts them."""
