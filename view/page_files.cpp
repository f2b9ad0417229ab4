// SPDX-License-Identifier: Apache-2.0
#include "view/page_files.h"

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string_view>
#include <utility>

#include "text/own_prefix.h"
#include "view/options.h"

namespace forcegrid::view {
namespace {

namespace fs = std::filesystem;

constexpr char kScript[] = "text/javascript; charset=utf-8";
constexpr std::array<std::pair<std::string_view, const char*>, 7> kTypes = {
    {{".html", "text/html; charset=utf-8"},
     {".css", "text/css; charset=utf-8"},
     {".js", kScript},
     {".mjs", kScript},
     {".svg", "image/svg+xml"},
     {".png", "image/png"},
     {".json", "application/json"}}};

// Null for a kind of file that pages don't load.
const char* type_of(const fs::path& file) {
  const std::string extension = file.extension().string();
  for (const auto& [ending, type] : kTypes) {
    if (ending == extension) {
      return type;
    }
  }
  return nullptr;
}

// `package` is what brings the file; empty if it is the project's own.
std::string content_of(const fs::path& file, const std::string& package) {
  std::ifstream stream(file, std::ios::binary);
  std::string content{std::istreambuf_iterator<char>(stream), {}};
  if (!stream || content.empty()) {
    throw ViewError("cannot read " + file.string() +
                    (package.empty() ? "; the page of the live view is not complete, install the "
                                       "program again"
                                     : "; install the package " + package));
  }
  return content;
}

}  // namespace

PageFolders default_page_folders() {
  PageFolders folders;
  if (const char* given = std::getenv("FORCEGRID_VIEW_PAGE"); given != nullptr) {
    folders.page = given;
    return folders;
  }
  std::error_code error;
  const std::string prefix = text::own_prefix();
  const fs::path installed = fs::path(prefix) / "share/forcegrid/view";
  folders.page = !prefix.empty() && fs::is_directory(installed, error)
                     ? installed.string()
                     : std::string(FORCEGRID_VIEW_SOURCE_PAGE);
  return folders;
}

PageFiles load_page_files(const PageFolders& folders) {
  PageFiles files;
  const fs::path page = folders.page;
  files["/index.html"] = {type_of("index.html"), content_of(page / "index.html", "")};
  for (const fs::directory_entry& entry : fs::directory_iterator(page)) {
    const char* type = type_of(entry.path());
    if (type != nullptr && entry.is_regular_file()) {
      files["/" + entry.path().filename().string()] = {type, content_of(entry.path(), "")};
    }
  }
  const fs::path three = folders.three;
  files["/three.module.js"] = {kScript, content_of(three / "three.module.js", "libjs-three")};
  files["/OrbitControls.js"] = {
      kScript, content_of(three / "examples/jsm/controls/OrbitControls.js", "libjs-three")};
  // It imports "../../../build/three.module.js". A browser takes each URL for a module of its own;
  // by this one there is a single three.js.
  files["/build/three.module.js"] = {kScript, "export * from \"/three.module.js\";\n"};
  const fs::path dygraphs = folders.dygraphs;
  files["/dygraph.js"] = {kScript, content_of(dygraphs / "dygraph.js", "libjs-dygraphs")};
  files["/dygraph.css"] = {type_of("dygraph.css"),
                           content_of(dygraphs / "dygraph.css", "libjs-dygraphs")};
  return files;
}

}  // namespace forcegrid::view
