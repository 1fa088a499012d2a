"""A small robot arm that waves, published as TF, and the lab around it."""
