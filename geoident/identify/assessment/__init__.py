"""How well the parameters are known, and what each reading contributes."""
