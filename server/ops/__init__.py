"""Operations: logs, metrics, readiness, and the start of the service's processes."""
