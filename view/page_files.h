// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

namespace forcegrid::view {

/// A file that browsers may have.
struct PageFile {
  std::string type;  ///< for Content-Type
  std::string content;
};

/// By the path of its URL; "/index.html" is the page itself.
using PageFiles = std::map<std::string, PageFile, std::less<>>;

/// Where the files are.
struct PageFolders {
  std::string page;  ///< index.html and what it loads
  std::string three = "/usr/share/javascript/three";
  std::string dygraphs = "/usr/share/javascript/dygraphs";
};

/// The page: the folder that FORCEGRID_VIEW_PAGE names; else share/forcegrid/view of an installed
/// program, else view/page of the sources. Real-time: no. Threads: before all others.
PageFolders default_page_folders();

/// Reads all files. The page's own keep their names; three.js is /three.module.js,
/// /OrbitControls.js and, for its import, /build/three.module.js; dygraphs /dygraph.js and
/// /dygraph.css. @throws ViewError naming the file and, where there is one, the package that is
/// missing. Real-time: no. Threads: any.
PageFiles load_page_files(const PageFolders& folders);

}  // namespace forcegrid::view
