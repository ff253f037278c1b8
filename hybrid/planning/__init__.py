"""Planning trials: what manoeuvres would show of each effect, which to make next, and a programme of them."""
