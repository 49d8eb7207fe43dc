"""Case files: what keys may say, and the case that they amount to."""
