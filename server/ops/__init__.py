"""Operations: logs, figures, readiness, and how processes of the service start."""
