"""What acts on the ground: weight, loads, water, temperature, supports, release."""
