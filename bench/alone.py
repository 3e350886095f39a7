"""Runs a command and prints, as JSON, what it took: run by `bench.plans` as a process of its own.

On Linux a process counts the memory of the one that started it as its own peak, because what is
there before `exec` is never forgotten. Started by this small process, a command reports no memory
but its own, however much the process that measures has used before.
"""

import json
import os
import subprocess
import sys
import time


def main(command: list[str]) -> None:
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert process.stdout is not None
    output = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    measured = {
        "seconds": time.perf_counter() - began,
        "peak_mb": usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3),  # bytes there
        "exit_code": process.returncode,
        "output": output.decode(),
    }
    print(json.dumps(measured))


if __name__ == "__main__":
    main(sys.argv[1:])
