"""Documents and skeletons for users, made from the schema."""
