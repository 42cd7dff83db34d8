"""What a path is: compact vertices, path records, and the one tracer that tracing and replay share."""
