"""Commands for any TF, what they share, and the page in the browser."""
