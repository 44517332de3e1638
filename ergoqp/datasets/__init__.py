"""Labelled postures: drawn, streamed, on disk, from tables; and how well a cost predicts them."""
