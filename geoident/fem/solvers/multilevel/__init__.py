"""Conjugate gradients on several levels: for models whose factor is beyond the memory."""
