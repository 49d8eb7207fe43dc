"""Perfect and hardening plasticity at strain points: from trial stresses to admissible ones."""
