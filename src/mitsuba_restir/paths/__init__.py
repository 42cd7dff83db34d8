"""What a path is: compact vertices, path records, and the tracer that all passes share."""
