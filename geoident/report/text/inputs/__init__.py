"""What a case says of ground, construction, structures and supports, in tables and sentences."""
