"""The whole cell in simulated time: controller, drivers and wires against the simulated plant, which is the witness."""
