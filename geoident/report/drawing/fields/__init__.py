"""Fields on a plane or on a cut: motions, stresses, how near the ground is to yielding."""
