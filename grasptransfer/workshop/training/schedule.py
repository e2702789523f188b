"""What each training step uses: its learning rate and its batch, from its number alone."""

WARM_UP = 300  # steps until the learning rate has risen to its peak
DECAY = 0.3  # the last share of the steps, over which it falls to zero
ECHO_WINDOW = 8  # batches between two uses of the same one


def learning_rate(step: int, steps: int, peak: float) -> float:
    """Rises, stays, falls: all but the fall is the same for any number of steps, so runs can be prolonged."""
    falling = (steps - step) / (steps - decay_start(steps))
    return peak * min((step + 1) / WARM_UP, 1.0, falling)


def decay_start(steps: int) -> int:
    """The step from which the learning rate falls."""
    return min(round((1 - DECAY) * steps), steps - 1)


def batch_number(step: int, echo: int) -> int:
    """Which batch a step uses: windows of batches are repeated `echo` times, so no batch follows itself."""
    window, place = divmod(step, ECHO_WINDOW * echo)
    return window * ECHO_WINDOW + place % ECHO_WINDOW
