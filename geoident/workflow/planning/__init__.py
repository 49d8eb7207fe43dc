"""Which gauges to take: what is to be known, what readings would tell of it, the choice."""
