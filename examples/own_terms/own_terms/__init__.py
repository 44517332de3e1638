"""Terms of their own for ergoqp, one file each."""
