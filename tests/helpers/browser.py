"""A headless Chromium, controlled through its DevTools protocol over a pair of pipes."""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
# Timeout in seconds: failures may wait for ever, while successes take seconds even on a busy
# machine.
PATIENCE = 60.0


class Browser:
    """One page of a browser without a profile; a context manager.

    `complaints` are the page's log messages at the level of a warning or above, its exceptions, and
    its requests to anywhere but `origin`, if that is given. `arguments` are Chromium's.
    """

    def __init__(self, *arguments, origin=None):
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_browser, self._commands = os.pipe()
        self._answers, from_browser = os.pipe()
        command = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"]
        command += ["--disable-dev-shm-usage"]  # which is small in containers
        command += arguments
        self._own = ("file:", "data:", *(() if origin is None else (origin, f"blob:{origin}")))
        command += ["--remote-debugging-pipe", f"--user-data-dir={self._profile.name}"]
        # The browser reads from descriptor 3 and writes to 4.
        redirect = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        self._process = subprocess.Popen(
            ["bash", "-c", redirect, "chromium", *command, "about:blank"],
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._received, self._number, self._session = b"", 0, None
        self._features = []
        self.events, self.complaints = [], []

    def __enter__(self):
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        attached = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        return self

    def __exit__(self, *error):
        os.close(self._commands)  # which ends the browser
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._answers)
        self._profile.cleanup()

    def send(self, method, **params):
        """Send a command and return its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]

    def open(self, path):
        """Load a file, or a page by its address."""
        self.events.clear()
        self.send("Page.navigate", url=path if isinstance(path, str) else path.resolve().as_uri())
        while "Page.loadEventFired" not in self.events:
            self._receive()

    def evaluate(self, expression):
        """Return the value of an expression of JavaScript, or of its promise."""
        done = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in done, done
        return done["result"].get("value")

    def wait_for(self, expression):
        """Wait until an expression of JavaScript is true, and return its value."""
        end = time.monotonic() + PATIENCE
        while not (value := self.evaluate(expression)):
            assert time.monotonic() < end, f"in vain: {expression}"
            time.sleep(0.05)
        return value

    def forget_refusals(self, count=1):
        """Wait for `count` complaints about requests that the server refused, and clear them."""
        end = time.monotonic() + PATIENCE
        while len(self.complaints) < count:
            assert time.monotonic() < end, "no request was refused"
            self.evaluate("0")  # receives pending messages
            time.sleep(0.05)
        assert all("status of 4" in each["text"] for each in self.complaints), self.complaints
        self.complaints.clear()

    def press_key(self, key, *, ctrl=False, shift=False):
        modifiers = 2 * ctrl + 8 * shift
        for kind in ("keyDown", "keyUp"):
            self.send(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                code=key,
                modifiers=modifiers,
                **KEY_CODES[key],
            )

    def choose_files(self, selector, *paths):
        """Choose files in an input, as its dialogue does."""
        root = self.send("DOM.getDocument")["root"]["nodeId"]
        node = self.send("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.send("DOM.setFileInputFiles", nodeId=node, files=[str(path) for path in paths])

    def drag(self, start, end, steps=5):
        """Press the mouse at a point, move to another, and release."""
        event = "Input.dispatchMouseEvent"
        (x, y), (to_x, to_y) = start, end
        self.send(event, type="mousePressed", x=x, y=y, button="left", clickCount=1)
        for step in range(1, steps + 1):
            at = {"x": x + (to_x - x) * step / steps, "y": y + (to_y - y) * step / steps}
            self.send(event, type="mouseMoved", button="left", buttons=1, **at)
        self.send(event, type="mouseReleased", x=to_x, y=to_y, button="left", clickCount=1)

    def click(self, x, y):
        for kind in ("mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def turn_wheel(self, x, y, by):
        """Turn the wheel over a point by a number of pixels; positive is downwards."""
        event = "Input.dispatchMouseEvent"
        self.send(event, type="mouseWheel", x=x, y=y, deltaX=0, deltaY=by)

    def drag_finger(self, start, end, y, steps=5):
        """Touch, move along a row, and lift."""
        touch = "Input.dispatchTouchEvent"
        self.send(touch, type="touchStart", touchPoints=[{"x": start, "y": y}])
        for step in range(1, steps + 1):
            x = start + (end - start) * step / steps
            self.send(touch, type="touchMove", touchPoints=[{"x": x, "y": y}])
        self.send(touch, type="touchEnd", touchPoints=[])

    def screen(self, width, height=900, *, phone=False):
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=phone,
        )
        self.send("Emulation.setTouchEmulationEnabled", enabled=phone)

    def colour_scheme(self, scheme):
        self._features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.send("Emulation.setEmulatedMedia", features=self._features)

    def media(self, kind):
        """Show the page for media "print" or the screen ("")."""
        self.send("Emulation.setEmulatedMedia", media=kind, features=self._features)

    def screenshot(self):
        """Return the whole page as PNG."""
        shot = self.send("Page.captureScreenshot", captureBeyondViewport=True)
        return base64.b64decode(shot["data"])

    def pdf(self):
        printed = self.send("Page.printToPDF", printBackground=False)
        return base64.b64decode(printed["data"])

    def _receive(self):
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._received:
            ready = select.select([self._answers], [], [], max(0.0, end - time.monotonic()))[0]
            assert ready, "the browser does not answer"
            received = os.read(self._answers, 1 << 20)
            assert received, "the browser has ended"
            self._received += received
        text, self._received = self._received.split(b"\0", 1)
        message = json.loads(text)
        self._note(message)
        return message

    def _note(self, message):
        method, params = message.get("method", ""), message.get("params", {})
        self.events.append(method)
        if method == "Runtime.exceptionThrown":
            self.complaints.append(params["exceptionDetails"])
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("warning", "error"):
            self.complaints.append(params)
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("warning", "error"):
            self.complaints.append(params["entry"])
        elif method == "Network.requestWillBeSent":
            url = params["request"]["url"]
            if not url.startswith(self._own):
                self.complaints.append(f"fetches {url}")


KEY_CODES = {
    "Home": {"windowsVirtualKeyCode": 36},
    "End": {"windowsVirtualKeyCode": 35},
    "Tab": {"windowsVirtualKeyCode": 9},
    "Enter": {"windowsVirtualKeyCode": 13, "text": "\r"},
    " ": {"windowsVirtualKeyCode": 32, "text": " "},
    "Escape": {"windowsVirtualKeyCode": 27},
    "Delete": {"windowsVirtualKeyCode": 46},
    "ArrowLeft": {"windowsVirtualKeyCode": 37},
    "ArrowUp": {"windowsVirtualKeyCode": 38},
    "+": {"windowsVirtualKeyCode": 187, "text": "+"},
    "-": {"windowsVirtualKeyCode": 189, "text": "-"},
    "ArrowRight": {"windowsVirtualKeyCode": 39},
    "ArrowDown": {"windowsVirtualKeyCode": 40},
    "z": {"windowsVirtualKeyCode": 90},
}
