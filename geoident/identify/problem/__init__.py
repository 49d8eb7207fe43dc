"""What an identifier is given and gives back: the problem, the model, scaling, methods."""
