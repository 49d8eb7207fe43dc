"""Water that takes time to leave the ground: stages that last, step by step (theory 17)."""
