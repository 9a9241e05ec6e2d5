"""Evolution of fiber layouts: genomes, variation, constraints, AFPO, scoring, checkpoints, workers."""
