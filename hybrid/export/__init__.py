"""A vessel model in the forms that other simulators take, each from the equations that the simulator compiles."""
