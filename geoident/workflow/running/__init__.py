"""What all jobs share: inputs and readings, outputs, control, cost, logs of evaluations."""
