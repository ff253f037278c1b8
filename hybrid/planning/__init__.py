"""Before a trial: what manoeuvres would show of each effect, which to make next, and a programme of them."""
