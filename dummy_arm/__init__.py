"""A small arm that waves, published as TF, and TF itself in pure Python."""
