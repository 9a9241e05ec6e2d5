"""`labctl run`, and the requests to a running protocol: pause, resume, abort."""
