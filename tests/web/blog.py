"""Blog: a site of another origin that may embed folds of the shared service."""

import http.server
import threading


class Blog(http.server.ThreadingHTTPServer):
    """Server with an origin of its own.

    Attributes:
        html: Content of its one page, at every address.
        origin: Its address.
    """

    def __init__(self) -> None:
        self.html = ""
        super().__init__(("127.0.0.1", 0), _Answer)
        self.origin = f"http://127.0.0.1:{self.server_port}"
        threading.Thread(target=self.serve_forever, daemon=True).start()


class _Answer(http.server.BaseHTTPRequestHandler):
    server: Blog

    def do_GET(self) -> None:
        body = self.server.html.encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        del arguments
