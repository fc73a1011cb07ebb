#!/bin/sh
# roslibpy while its rosbridge is away: what becomes of goals that are published meanwhile.
#
# Seen with roslibpy 2.1.0 and a server of websockets 16.1.1 that closes the connection: publish() of five
# goals raises nothing and says nothing; when the connection comes back, by itself and a second later, all
# five are sent at once, before the topic is advertised again.
#
# Guess beforehand: a publisher without a connection drops what it is given, or raises, as a topic of ROS
# has no memory: a robot whose link was cut gets the goals of after, not those of before.
# What seems to happen: each message waits for the event that the connection is ready, and that one fires
# for all that wait.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "roslibpy==2.1.0" "websockets==16.1.1"
cat > late.py <<'PYTHON'
import json
import os
import sys
import threading
import time
from importlib.metadata import version

import roslibpy
from websockets.sync.server import serve

heard, clients = [], []


def serving(client):
    clients.append(client)
    try:
        for text in client:
            heard.append((time.monotonic(), len(clients), json.loads(text)))
    except Exception:
        pass


server = serve(serving, "127.0.0.1", 0)
threading.Thread(target=server.serve_forever, daemon=True).start()
ros = roslibpy.Ros("127.0.0.1", server.socket.getsockname()[1])
ros.run(timeout=20)
topic = roslibpy.Topic(ros, "/goal", "std_msgs/String")
topic.advertise()
topic.publish(roslibpy.Message({"data": "before"}))
time.sleep(0.5)
clients[0].close()
while ros.is_connected:
    time.sleep(0.01)
for number in range(5):
    topic.publish(roslibpy.Message({"data": f"late {number}"}))
    time.sleep(0.1)
last, end = time.monotonic(), time.monotonic() + 30.0
while len(heard) < 8 and time.monotonic() < end:
    time.sleep(0.05)
print(f"roslibpy {version('roslibpy')}, websockets {version('websockets')}")
late = [(at, each["msg"]["data"]) for at, which, each in heard if which == 2 and each["op"] == "publish"]
for at, word in late:
    print(f"{word}: {at - last:+.2f} s after the last was published")
seen = [word for _, word in late] == [f"late {number}" for number in range(5)]
seen = seen and late[-1][0] - late[0][0] < 0.2
sys.stdout.flush()
os._exit(not seen)
PYTHON
env/bin/python late.py
