"""Who simulates: this process, processes beside it, or a cluster."""
