"""Heat that the ground conducts in stages that last: temperatures step by step (theory 18.7)."""
