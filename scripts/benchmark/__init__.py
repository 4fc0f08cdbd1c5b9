"""Parts run by ``scripts/bench``, which measure the speeds stated in the documentation."""
