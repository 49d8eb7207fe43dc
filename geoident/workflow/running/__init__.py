"""What the commands share: inputs, outputs, jobs, logs of evaluations, tables."""
