"""Figures of matplotlib as files, with words that can be searched, copied and read aloud."""
