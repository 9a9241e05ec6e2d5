"""`labctl run`, and the requests to a running protocol: pause, resume, abort."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
