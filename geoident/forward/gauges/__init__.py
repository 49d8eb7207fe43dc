"""What the gauges see, and what they add by themselves."""
