"""Real robots: their messages, the clock of their motion, and their shares of joint angles."""
