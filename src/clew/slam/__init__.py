"""The pipeline from measurements to trajectory, graph and map; the only stateful room."""
