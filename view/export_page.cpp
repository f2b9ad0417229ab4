// SPDX-License-Identifier: Apache-2.0
#include "view/export_page.h"

#include <fcntl.h>
#include <sodium.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string_view>
#include <vector>

#include "view/options.h"

namespace forcegrid::view {
namespace {

using view_link::Bytes;

// A page that is opened from a file may load nothing else: all its parts are in it.
constexpr char kPolicy[] =
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src "
    "'unsafe-inline' data:; style-src 'unsafe-inline'; img-src data: blob:\">\n";
constexpr char kPart[] = ".part";         // of a file that is not complete
constexpr char kPrefix[] = "forcegrid/";  // of the names of modules
constexpr int kGzip = 15 + 16;            // window bits that ask zlib for gzip's header
constexpr int kMemory = 8;

std::string base64(std::string_view bytes) {
  std::string text(sodium_base64_ENCODED_LEN(bytes.size(), sodium_base64_VARIANT_ORIGINAL), '\0');
  sodium_bin2base64(text.data(), text.size(), reinterpret_cast<const unsigned char*>(bytes.data()),
                    bytes.size(), sodium_base64_VARIANT_ORIGINAL);
  text.resize(std::strlen(text.c_str()));
  return text;
}

std::string gzip(const Bytes& bytes) {
  z_stream stream{};
  if (deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, kGzip, kMemory, Z_DEFAULT_STRATEGY) !=
      Z_OK) {
    throw ViewError("zlib can't compress: not enough memory");
  }
  std::string packed(deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = const_cast<Bytef*>(bytes.data());
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  const int result = deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  if (result != Z_STREAM_END) {
    throw ViewError("zlib can't compress the recording");
  }
  return packed;
}

void replace_all(std::string& text, std::string_view what, std::string_view by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size()) {
    text.replace(at, what.size(), by);
  }
}

const std::string& content_of(const PageFiles& files, std::string_view name) {
  const auto found = files.find(name);
  if (found == files.end()) {
    throw ViewError("the page has no file " + std::string(name) + "; install the program again");
  }
  return found->second.content;
}

// A script or style that stands in the page: nothing in it may end its element.
std::string inside(std::string text, std::string_view element) {
  replace_all(text, "</" + std::string(element), "<\\/" + std::string(element));
  return text;
}

// Replaces the one element that begins with `begin` and ends with `end`.
void replace_element(std::string& page, const std::string& begin, const std::string& end,
                     const std::string& by) {
  const std::size_t from = page.find(begin);
  const std::size_t to = from == std::string::npos ? from : page.find(end, from);
  if (to == std::string::npos) {
    throw ViewError("the page's index.html has no '" + begin + "'; it can't be exported");
  }
  page.replace(from, to + end.size() - from, by);
}

// Modules name each other by bare names: a module of a data: address can't resolve others.
std::string import_map(const PageFiles& files) {
  std::string map = "<script type=\"importmap\">{\"imports\":{";
  bool first = true;
  for (const auto& [name, file] : files) {
    const bool is_module = name.ends_with(".js") && name != "/dygraph.js" &&
                           name != "/OrbitControls.js" && name.find('/', 1) == std::string::npos;
    if (is_module) {
      std::string script = file.content;
      replace_all(script, "from '/", std::string("from '") + kPrefix);
      map += (first ? "\"" : ",\"") + (kPrefix + name.substr(1)) + "\":\"data:text/javascript;" +
             "base64," + base64(script) + "\"";
      first = false;
    }
  }
  return map + "}}</script>\n";
}

}  // namespace

std::string page_with(const PageFiles& files, const std::string& recording) {
  std::string page = content_of(files, "/index.html");
  replace_element(page, "<link rel=\"icon\"", ">",
                  kPolicy + std::string("<link rel=\"icon\" href=\"data:image/svg+xml;base64,") +
                      base64(content_of(files, "/icon.svg")) + "\">");
  static constexpr std::string_view kStyle = "<link rel=\"stylesheet\" href=\"";
  for (std::size_t at = page.find(kStyle); at != std::string::npos; at = page.find(kStyle, at)) {
    const std::size_t from = at + kStyle.size();
    const std::string name = page.substr(from, page.find('"', from) - from);
    replace_element(page, std::string(kStyle) + name, ">",
                    "<style>\n" + inside(content_of(files, name), "style") + "</style>");
  }
  replace_element(page, "<script src=\"/dygraph.js\"", "</script>",
                  "<script>\n" + inside(content_of(files, "/dygraph.js"), "script") + "</script>");
  replace_element(page, "<script src=\"/main.js\"", "</script>",
                  import_map(files) + "<script id=\"exported\" type=\"application/octet-stream\">" +
                      recording + "</script>\n<script type=\"module\">import '" + kPrefix +
                      "main.js';</script>");
  return page;
}

std::string exported_page(const PageFiles& files, ExportRecord& record, std::size_t largest_bytes) {
  for (;;) {
    const std::string left_out = record.left_out();
    const std::string note =
        left_out.empty() ? "" : "To keep the file small, it has only " + left_out + ".";
    std::string page = page_with(files, base64(gzip(record.pack(note))));
    if (page.size() <= largest_bytes) {
      return page;
    }
    if (!record.thin()) {
      throw ViewError("the page has " + std::to_string(page.size() / 1000) +
                      " kB at the least, more than it may; allow more with --export-MB");
    }
  }
}

void check_export(const std::string& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
    throw ViewError("--export " + file + ": it is there and no plain file; choose another name");
  }
  const std::string part = file + kPart;
  const int descriptor = ::open(part.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
  if (descriptor < 0) {
    throw ViewError("--export " + file + ": can't be made (" + std::strerror(errno) +
                    "); name a file in a folder that exists and is writable");
  }
  ::close(descriptor);
  ::unlink(part.c_str());
}

void write_export(const std::string& file, const std::string& text) {
  const std::string part = file + kPart;
  const auto fail = [&](const std::string& doing) {
    const std::string reason = std::strerror(errno);
    ::unlink(part.c_str());
    throw ViewError("--export " + file + ": can't be " + doing + " (" + reason +
                    "); name a file on a disk with room for it");
  };
  const int descriptor = ::open(part.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0) {
    fail("made");
  }
  for (std::size_t at = 0; at < text.size();) {
    const ssize_t written = ::write(descriptor, text.data() + at, text.size() - at);
    if (written < 0 && errno != EINTR) {
      ::close(descriptor);
      fail("written");
    }
    at += written > 0 ? static_cast<std::size_t>(written) : 0;
  }
  if (::fsync(descriptor) != 0 && errno != EINVAL && errno != EROFS) {
    ::close(descriptor);
    fail("written");
  }
  if (::close(descriptor) != 0 || ::rename(part.c_str(), file.c_str()) != 0) {
    fail("completed");
  }
}

}  // namespace forcegrid::view
