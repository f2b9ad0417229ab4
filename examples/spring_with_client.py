#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""F = -k (P - P0), the spring of spring_simulator.py, with the package forcegrid or, without it,
with forcegrid_link.py, the same client in one file to copy.
usage: spring_with_client.py PORT [STIFFNESS_N_PER_M [KEY_FILE]]"""
import signal
import sys

try:
    from forcegrid import LinkError, SimulatorLink
except ImportError:
    from forcegrid_link import LinkError, SimulatorLink

PERIOD_S, REACH_M = 1 / 30, 0.005  # the spring catches a tool this near to the origin


def main():
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it without a traceback
    try:
        port, stiffness_N_per_m = int(sys.argv[1]), float((sys.argv + ["100"])[2])
    except (IndexError, ValueError):
        sys.exit(__doc__)
    try:
        link = SimulatorLink("127.0.0.1", port, key_files=sys.argv[3:])
    except (LinkError, OSError, OverflowError) as error:
        sys.exit(str(error))
    print("listening on 127.0.0.1:%d" % link.port, flush=True)
    first_W_m = None

    def answer(request):
        position_W_m = request.position_W_m
        if first_W_m is None:
            link.answer(request, [0.0] * 3, in_contact=False, converged=True)
            return
        link.answer(request, [-stiffness_N_per_m * (p - p0) for p, p0 in zip(position_W_m, first_W_m)],
                    in_contact=True, converged=True, contact_epoch=1, contact_point_W_m=first_W_m,
                    stiffness_W_N_per_m=[-stiffness_N_per_m * (i % 4 == 0) for i in range(9)])

    while True:
        news = link.receive(PERIOD_S)
        if news.new_session or news.servo_ended:
            first_W_m = None
        if news.tool_state:
            p = news.tool_state.position_W_m
            if first_W_m is None and sum(x * x for x in p) < REACH_M**2:
                first_W_m = p
            answer(news.tool_state)
        while query := link.next_query():
            answer(query)


if __name__ == "__main__":
    main()
