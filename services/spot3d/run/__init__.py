"""A whole run on one machine: processes, supervision, results and the picture of them."""
