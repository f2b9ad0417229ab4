// SPDX-License-Identifier: Apache-2.0
#include "view/page_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>
#include <string>

#include "view/options.h"

namespace forcegrid::view {
namespace {

namespace fs = std::filesystem;

class Page : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = "/tmp/view-page-test-XXXXXX";
    EXPECT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
    write("index.html", "<!doctype html>");
    folders_.page = folder_.string();
  }
  void TearDown() override { fs::remove_all(folder_); }

  void write(const std::string& name, const std::string& content) const {
    std::ofstream(folder_ / name) << content;
  }
  std::string refusal() const {
    try {
      load_page_files(folders_);
    } catch (const ViewError& error) {
      return error.what();
    }
    return "all is there";
  }

  fs::path folder_;
  PageFolders folders_;
};

TEST_F(Page, HasItsFilesAndThoseOfThePackages) {
  write("app.js", "code");
  write("style.css", "body {}");
  write("notes.txt", "not for browsers");
  write(".hidden", "not for browsers");
  fs::create_directory(folder_ / "folder.js");
  const PageFiles files = load_page_files(folders_);
  EXPECT_EQ(files.at("/app.js").type, "text/javascript; charset=utf-8");
  EXPECT_EQ(files.at("/app.js").content, "code");
  EXPECT_EQ(files.at("/style.css").type, "text/css; charset=utf-8");
  EXPECT_EQ(files.at("/index.html").type, "text/html; charset=utf-8");
  EXPECT_GT(files.at("/three.module.js").content.size(), 100'000U);
  EXPECT_GT(files.at("/dygraph.js").content.size(), 100'000U);
  EXPECT_GT(files.at("/dygraph.css").content.size(), 100U);
  EXPECT_EQ(files.size(), 8U) << "and OrbitControls.js with the three.js that it imports";
}

// "../../../build/three.module.js" of /OrbitControls.js is /build/three.module.js: no path leads
// out of the root.
TEST_F(Page, HasTheThreeJsThatTheOrbitControlsImport) {
  const PageFiles files = load_page_files(folders_);
  const std::string& controls = files.at("/OrbitControls.js").content;
  std::smatch import;
  ASSERT_TRUE(std::regex_search(controls, import, std::regex("from \"((?:\\.\\./)+)([^\"]+)\"")));
  const std::string path = "/" + import[2].str();
  ASSERT_EQ(files.count(path), 1U) << path;
  EXPECT_THAT(files.at(path).content, testing::HasSubstr("\"/three.module.js\""));
}

TEST_F(Page, NamesThePackageThatIsMissing) {
  folders_.three = folder_.string();
  EXPECT_THAT(refusal(), testing::HasSubstr("install the package libjs-three"));
  folders_ = {.page = folder_.string(), .dygraphs = "/nowhere"};
  EXPECT_THAT(refusal(), testing::AllOf(testing::HasSubstr("/nowhere/dygraph.js"),
                                        testing::HasSubstr("libjs-dygraphs")));
}

TEST_F(Page, NamesItsOwnFileThatIsMissing) {
  fs::remove(folder_ / "index.html");
  EXPECT_THAT(refusal(), testing::HasSubstr("index.html"));
}

TEST_F(Page, IsWhereTheEnvironmentSays) {
  ::setenv("FORCEGRID_VIEW_PAGE", "/some/where", 1);
  EXPECT_EQ(default_page_folders().page, "/some/where");
  ::unsetenv("FORCEGRID_VIEW_PAGE");
  EXPECT_TRUE(default_page_folders().page.ends_with("/view/page"))
      << default_page_folders().page << ": this test is not installed";
}

}  // namespace
}  // namespace forcegrid::view
