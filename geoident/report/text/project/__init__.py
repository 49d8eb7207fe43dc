"""What is said of several sections of one ground."""
