"""The words of `text` and the figures of `drawing` as one self-contained page."""
