#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""forcegrid-view over TLS: its pages, names, handshakes and key files.
usage: server_tls_test.py FORCEGRID_VIEW [TEST...]"""
import pathlib
import random
import re
import select
import socket
import ssl
import subprocess
import tempfile
import time
import unittest
import warnings

import peers
from peers import FEED, Page, Peer, View, http, shape_bytes, surface_bytes
from with_view import PROGRAM, SEED, WithView


class Encrypted(WithView):
    """The same over TLS, on a loopback address."""
    LISTEN = "127.0.0.1:0"

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.key_file = peers.make_key_file(pathlib.Path(self.folder.name) / "view.pem")
        self.view = View(PROGRAM, "--listen", self.LISTEN, "--key", self.key_file)
        self.addCleanup(self.end)

    def test_gives_the_page_to_the_token(self):
        view = self.view
        status, headers, body = http(view, "/?token=" + view.token)
        self.assertEqual(status, 200)
        self.assertIn(b"<title>page</title>", body)
        self.assertIn("connect-src 'self' wss://%s;" % view.host, headers["content-security-policy"])
        self.assertNotIn("set-cookie", headers)
        self.assertEqual(http(view, "/?token=" + "0" * 64)[0], 403)
        self.assertEqual(http(view, "/")[0], 403)
        large = http(view, "/three.module.js")
        self.assertEqual((large[0], int(large[1]["content-length"])), (200, len(large[2])))
        self.assertGreater(len(large[2]), 500_000)

    def test_has_the_certificate_of_its_file_which_a_browser_can_check(self):
        context = ssl.create_default_context(cafile=self.key_file)
        with context.wrap_socket(self.view.connect_plain(), server_hostname="localhost") as browser:
            self.assertIn(browser.version(), ("TLSv1.2", "TLSv1.3"))
        said = subprocess.run(["openssl", "x509", "-in", self.key_file, "-noout", "-fingerprint",
                               "-sha256"], capture_output=True, text=True, check=True).stdout
        self.assertEqual(said.strip().split("=")[1].replace(":", "").lower(), self.view.certificate)

    def test_serves_several_requests_on_one_connection_and_says_goodbye(self):
        request = "GET /app.js HTTP/1.1\r\nHost: %s\r\n\r\n" % self.view.host
        last = request.replace("\r\n\r\n", "\r\nConnection: close\r\n\r\n")
        context = peers.unchecked_tls()
        with context.wrap_socket(self.view.connect_plain(), suppress_ragged_eofs=False) as browser:
            browser.sendall((request + request + last).encode())
            data = b""
            while piece := browser.recv(65536):  # without TLS's goodbye this is an SSLEOFError
                data += piece
        self.assertEqual(data.count(b"HTTP/1.1 200 OK"), 3)

    def test_opens_a_web_socket_for_its_own_page_and_for_scripts_with_the_token(self):
        host = self.view.host
        for origin, token, status in ((True, None, 101), (None, None, 101),
                                      ("https://evil.example", None, 403), ("null", None, 403),
                                      ("http://" + host, None, 403), (True, "", 403),
                                      (True, "0" * 64, 403)):
            with Page(self.view, token=token, origin=origin) as page:
                self.assertEqual(page.status, status, (origin, token))

    def test_shows_a_run_and_passes_commands_on(self):
        page, run = self.live_page()
        with Peer(self.view.folder + "/surface") as simulator:
            shape = shape_bytes([(0.001 * i, 0, 0) for i in range(20_000)], [(0, 1, 2)])
            simulator.send(2, shape)
            self.assertEqual(page.receive_type(2), b"\x02\0\0\0" + shape)
            for number in range(200):
                surface = surface_bytes([(number, 2, 3)] * 20_000)
                simulator.send(3, surface)
                run.cycle(number, 10**12 + number * 11_000_000)
            while page.receive_type(3) != b"\x03\0\0\0" + surface:
                pass
        page.send({"id": 1, "what": "stop"})
        self.assertEqual(run.command()["what"], "stop")
        with Page(self.view) as bad:
            bad.receive_type("hello")
            bad.send("no JSON")
            self.assertEqual(bad.closing_code(), 1008)

    def test_ends_pages_with_a_goodbye(self):
        page, run = self.live_page()
        self.view.process.stdin.close()
        run.send(FEED["end"], {"ended_by": "time"})
        run.connection.close()
        self.assertEqual(page.receive_type("end")["ended_by"], "time")
        self.assertEqual(page.closing_code(), 1001)
        self.assertEqual(self.view.process.wait(peers.TIMEOUT_S), 0)
        self.view.close()
        self.view = View(PROGRAM)  # which the end of each test looks for

    def test_refuses_another_host_name_that_resolves_to_this_machine(self):
        for host in ("evil.example", "evil.example:%d" % self.view.port, "127.0.0.1", ""):
            status, _, body = http(self.view, "/?token=" + self.view.token, host=host)
            self.assertEqual(status, 403, host)
            self.assertNotIn(b"<title>", body)
            with Page(self.view, host=host or "none", origin=None) as page:
                self.assertEqual(page.status, 403, host)
        self.assertEqual(http(self.view, "/app.js", host="localhost:%d" % self.view.port)[0], 200)

    def test_answers_http_without_tls_in_a_sentence_and_shows_nothing(self):
        with self.view.connect_plain() as connection:
            connection.sendall(("GET /?token=%s HTTP/1.1\r\nHost: %s\r\n\r\n" % (
                self.view.token, self.view.host)).encode())
            status, _, body = peers.read_answer(connection)
        self.assertEqual(status, 400)
        self.assertIn(b"https", body)
        self.assertNotIn(b"<title>", body)

    def test_drops_what_is_no_tls(self):
        generator = random.Random(SEED)
        begin = bytes.fromhex("16030102000100")
        for number in range(60):
            with self.view.connect_plain() as connection:
                try:
                    bad = generator.randbytes(generator.randrange(1, 4000))
                    connection.sendall(begin + bad if number % 2 else bad)
                    connection.shutdown(socket.SHUT_WR)
                    while connection.recv(65536):
                        pass
                except OSError:
                    pass  # it may close before all is sent
        # Random bytes over TLS, and a connection that breaks off within it.
        for _ in range(20):
            with self.view.connect() as connection:
                try:
                    connection.sendall(generator.randbytes(generator.randrange(1, 4000)))
                    connection.recv(65536)
                except OSError:
                    pass
        self.view.wait_until_it_says("dropped a connection: TLS: ")

    def test_speaks_tls_of_1_2_and_later(self):
        versions = ssl.TLSVersion
        for version, served in ((versions.TLSv1, False), (versions.TLSv1_1, False),
                                (versions.TLSv1_2, True), (versions.TLSv1_3, True)):
            context = peers.unchecked_tls()
            context.set_ciphers("ALL:@SECLEVEL=0")  # else this end would not try
            with self.subTest(version=version), self.view.connect_plain() as connection:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", DeprecationWarning)
                    context.minimum_version = context.maximum_version = version
                if served:
                    with context.wrap_socket(connection) as browser:
                        self.assertEqual(browser.version().replace(".", "_"), version.name)
                else:
                    with self.assertRaisesRegex(ssl.SSLError, "PROTOCOL_VERSION|WRONG_VERSION"):
                        context.wrap_socket(connection)

    def test_drops_a_half_open_handshake_after_10_s_and_serves_others_meanwhile(self):
        begin = time.monotonic()
        silent, slow = self.view.connect_plain(), self.view.connect_plain()
        self.addCleanup(silent.close)
        self.addCleanup(slow.close)
        slow.sendall(bytes.fromhex("16030100"))  # of the five bytes that lead a record
        page, run = self.live_page()
        page.send({"id": 1, "what": "stop"})
        self.assertEqual(run.command()["what"], "stop")
        for connection in (silent, slow):
            connection.settimeout(2 * peers.TIMEOUT_S)
            try:
                self.assertEqual(connection.recv(1), b"")
            except ConnectionResetError:
                pass
        self.assertGreater(time.monotonic() - begin, 9.5)
        self.assertLess(time.monotonic() - begin, 15)
        self.view.wait_until_it_says("no TLS within 10 s")
        page.send({"id": 2, "what": "stop"})
        self.assertEqual(run.command()["what"], "stop", "the page goes on")

    def test_counts_handshakes_among_the_32_connections(self):
        page, run = self.live_page()
        waiting = {self.view.connect_plain() for _ in range(60)}
        for connection in waiting:
            self.addCleanup(connection.close)
        while len(waiting) > 31:
            dropped, _, _ = select.select(waiting, [], [], peers.TIMEOUT_S)
            self.assertTrue(dropped, "%d connections are left, not 31" % len(waiting))
            waiting -= set(dropped)
        self.view.wait_until_it_says("there are 32 already")
        page.send({"id": 1, "what": "stop"})
        self.assertEqual(run.command()["what"], "stop", "the page's own connection goes on")
        for connection in waiting:
            connection.close()
        peers.wait_for(self.is_served)

    def is_served(self):
        try:
            return http(self.view, "/app.js")[0] == 200
        except OSError:  # dropped within the handshake
            return False

    def test_takes_no_memory_for_a_page_that_does_not_read(self):
        page, run = self.live_page()
        with Page(self.view) as deaf:
            deaf.receive_type("hello")
            for _ in range(60):
                run.send(FEED["note"], {"level": "info", "text": "x" * 60_000})
                page.receive_type("note")
            self.view.wait_until_it_says("disconnected a page that does not read")


class EncryptedEverywhere(unittest.TestCase):
    """On addresses that other machines reach."""

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.key_file = pathlib.Path(self.folder.name) / "view.pem"

    def start(self, listen, **names):
        """With a certificate of these names."""
        peers.make_key_file(self.key_file, **{"names": "IP:127.0.0.1", **names})
        view = View(PROGRAM, "--listen", listen, "--key", str(self.key_file))
        self.addCleanup(view.close)
        return view

    def test_answers_to_addresses_and_to_the_machines_name(self):
        view = self.start("0.0.0.0:0")
        self.assertEqual(view.address, "0.0.0.0")
        for name in ("127.0.0.1", "192.0.2.7", "[::1]", "[2001:db8::7]", socket.gethostname()):
            host = "%s:%d" % (name, view.port)
            self.assertEqual(http(view, "/?token=" + view.token, host=host)[0], 200, host)
            with Page(view, host=host) as page:
                self.assertEqual(page.status, 101, host)
            with Page(view, host=host, origin="http://" + host) as page:
                self.assertEqual(page.status, 403, host)
        for host in ("evil.example:%d" % view.port, socket.gethostname(), "127.0.0.1",
                     "%s.evil.example:%d" % (socket.gethostname(), view.port),
                     "127.0.0.1.evil.example:%d" % view.port, "127.0.0.1:1"):
            self.assertEqual(http(view, "/?token=" + view.token, host=host)[0], 403, host)
            with Page(view, host=host) as page:
                self.assertEqual(page.status, 403, host)

    def answers(self, view, name):
        """Whether the page and the WebSocket are given to who asks for this name: both or none."""
        host = "%s:%d" % (name, view.port)
        status = http(view, "/?token=" + view.token, host=host)[0]
        with Page(view, host=host) as page:
            self.assertIn((status, page.status), ((200, 101), (403, 403)), host)
        return status == 200

    def test_answers_to_the_names_of_its_certificate(self):
        view = self.start("127.0.0.1:0", common_name="common.test",
                          names="DNS:View.Lab.test,DNS:*.rooms.test,DNS:*.test,IP:192.0.2.7")
        for name in ("view.lab.test", "VIEW.lab.TEST", "one.rooms.test", "localhost"):
            self.assertTrue(self.answers(view, name), name)
        for name in ("common.test", "lab.test", "a.view.lab.test", "a.b.rooms.test", "rooms.test",
                     "*.rooms.test", "evil.test", "192.0.2.7", "view.lab.test.evil.example",
                     "evil.example"):
            self.assertFalse(self.answers(view, name), name)
        host = "view.lab.test:%d" % view.port
        for origin in ("http://" + host, "https://view.lab.test", "https://one.rooms.test:%d" % view.port,
                       "https://evil.example", "null"):
            with Page(view, host=host, origin=origin) as page:
                self.assertEqual(page.status, 403, origin)

    def test_answers_to_the_common_name_of_a_certificate_without_others(self):
        view = self.start("127.0.0.1:0", common_name="common.test", names=None)
        self.assertTrue(self.answers(view, "common.test"))
        self.assertFalse(self.answers(view, "evil.test"))

    def test_answers_to_the_listening_address_alone(self):
        own = next((address for address in subprocess.run(
            ["hostname", "-I"], capture_output=True, text=True).stdout.split() if "." in address),
                   None)
        if own is None:
            self.skipTest("this machine has no address but loopback")
        view = self.start(own + ":0")
        self.assertEqual(http(view, "/?token=" + view.token)[0], 200)
        for name in ("127.0.0.1", "localhost", socket.gethostname(), "192.0.2.7"):
            host = "%s:%d" % (name, view.port)
            self.assertEqual(http(view, "/?token=" + view.token, host=host)[0], 403, host)


class KeyFiles(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.good = pathlib.Path(peers.make_key_file(self.path("good.pem"))).read_text()
        self.key, self.certificate = re.fullmatch(
            "(-----BEGIN PRIVATE KEY.*?KEY-----\n)(-----BEGIN CERT.*)", self.good, re.DOTALL).groups()

    def path(self, name):
        return pathlib.Path(self.folder.name) / name

    def written(self, text, mode=0o600):
        file = self.path("view.pem")
        file.unlink(missing_ok=True)
        file.touch(0o600)
        file.write_text(text)
        file.chmod(mode)
        return file

    def refused(self, file, *words):
        """It ends at once, with one sentence that names the file, and reads nothing from a
        terminal."""
        done = subprocess.run([PROGRAM, "--listen", "0.0.0.0:0", "--key", str(file)],
                              capture_output=True, text=True, stdin=subprocess.DEVNULL,
                              start_new_session=True, timeout=peers.TIMEOUT_S)
        self.assertEqual((done.returncode, done.stdout), (2, ""), done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertTrue(done.stderr.startswith("forcegrid-view: view key file '%s': " % file),
                        done.stderr)
        for word in words:
            self.assertIn(word, done.stderr)

    def openssl(self, *arguments, text=""):
        return subprocess.run(["openssl", *arguments], input=text, capture_output=True, text=True,
                              check=True, timeout=peers.TIMEOUT_S).stdout

    def test_that_others_may_read_are_refused(self):
        for mode in (0o644, 0o640, 0o604, 0o620, 0o601):
            self.refused(self.written(self.good, mode), "its mode %04o" % mode, "chmod 600 '",
                         "make a new key")

    def test_that_are_none_are_refused_with_the_remedy(self):
        for file, words in ((self.path("none.pem"), "No such file"),
                            (self.path("."), "not a regular file"),
                            (self.written(""), "no private key")):
            self.refused(file, words, "openssl req -x509")
        self.refused(self.written("x" * 300_000), "256 KiB")

    def test_without_key_or_certificate_are_refused(self):
        self.refused(self.written(self.certificate), "has no private key", "append it")
        self.refused(self.written(self.key), "has no certificate", "append it")
        lines = self.key.splitlines(keepends=True)
        self.refused(self.written(lines[0] + "AAAA" + lines[-1] + self.certificate),
                     "its private key is damaged")
        lines = self.certificate.splitlines(keepends=True)
        self.refused(self.written(self.key + lines[0] + "AAAA" + lines[-1]),
                     "a certificate in it is damaged")
        self.refused(self.written(self.good + lines[0] + "AAAA" + lines[-1]),
                     "a certificate in it is damaged")

    def test_whose_key_is_another_ones_are_refused(self):
        other = pathlib.Path(peers.make_key_file(self.path("other.pem"))).read_text()
        self.refused(self.written(self.key + other[other.index("-----BEGIN CERT"):]),
                     "not that of its first certificate")

    def test_whose_key_is_encrypted_are_refused_without_a_question(self):
        encrypted = self.openssl("pkcs8", "-topk8", "-passout", "pass:secret", text=self.key)
        traditional = self.openssl("ec", "-aes256", "-passout", "pass:secret", text=self.key)
        self.assertIn("ENCRYPTED", encrypted)
        self.assertIn("Proc-Type: 4,ENCRYPTED", traditional)
        for key in (encrypted, traditional):
            self.refused(self.written(key + self.certificate), "is encrypted", "nobody is asked",
                         "openssl pkey -in")

    def test_whose_certificate_is_not_valid_now_are_refused(self):
        key_file = self.written(self.key)
        request = self.openssl("req", "-new", "-key", str(key_file), "-subj", "/CN=localhost")
        database = self.path("index.txt")
        config = self.path("ca.cnf")
        config.write_text("[ca]\ndefault_ca = own\n[own]\ndatabase = %s\nnew_certs_dir = %s\n"
                          "rand_serial = yes\ndefault_md = sha256\npolicy = any\n"
                          "[any]\ncommonName = supplied\n" % (database, self.folder.name))
        (self.path("request.csr")).write_text(request)
        for begin, end, words in (("20200101000000Z", "20210101000000Z", "has expired on Jan  1"),
                                  ("20900101000000Z", "20910101000000Z", "is not valid before")):
            database.write_text("")
            certificate = self.openssl(
                "ca", "-batch", "-notext", "-selfsign", "-config", str(config), "-keyfile",
                str(key_file), "-in", str(self.path("request.csr")), "-startdate", begin,
                "-enddate", end)
            self.refused(self.written(self.key + certificate), words, "openssl req -x509")
            self.written(self.key)

    def test_may_have_the_certificate_first_and_a_chain(self):
        other = pathlib.Path(peers.make_key_file(self.path("other.pem"))).read_text()
        more = other[other.index("-----BEGIN CERT"):]
        for text in (self.certificate + self.key, self.key + self.certificate + more,
                     self.certificate + more + self.key):
            view = View(PROGRAM, "--key", str(self.written(text)))
            self.assertEqual(http(view, "/?token=" + view.token)[0], 200)
            self.assertEqual(view.close(), 0)


if __name__ == "__main__":
    unittest.main()
