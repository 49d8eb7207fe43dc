"""Constants of the ground that are not one number: fields, and what grows."""
