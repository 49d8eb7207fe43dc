"""How a material yields, as a case says it."""
