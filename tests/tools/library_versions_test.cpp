// SPDX-License-Identifier: Apache-2.0
#include "tools/library_versions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <map>
#include <string>

namespace forcegrid::tools {
namespace {

std::map<std::string, std::string> by_name() {
  std::map<std::string, std::string> versions;
  for (const PartVersion& part : library_versions()) {
    EXPECT_TRUE(versions.emplace(part.name, part.version).second) << part.name << " twice";
  }
  return versions;
}

TEST(LibraryVersions, AreThoseThatThePackagesSayToo) {
  const std::map<std::string, std::string> versions = by_name();
  EXPECT_EQ(versions.at("libusb"), KNOWN_libusb_1_0);
  EXPECT_EQ(versions.at("hidapi"), KNOWN_hidapi_hidraw);
  EXPECT_EQ(versions.at("libsodium"), KNOWN_libsodium);
  EXPECT_EQ(versions.at("zlib"), KNOWN_zlib);
  EXPECT_EQ(versions.at("ZeroMQ"), KNOWN_libzmq);
  EXPECT_EQ(versions.at("HDF5"), KNOWN_hdf5);
  EXPECT_EQ(versions.at("Eigen"), KNOWN_eigen);
}

TEST(LibraryVersions, NameTheKernelThatRuns) {
  std::ifstream file("/proc/sys/kernel/osrelease");
  std::string release;
  file >> release;
  ASSERT_FALSE(release.empty());
  EXPECT_NE(by_name().at("kernel").find(release), std::string::npos);
}

TEST(LibraryVersions, NoneIsEmptyAndEachHasADigit) {
  for (const PartVersion& part : library_versions()) {
    EXPECT_TRUE(std::any_of(part.version.begin(), part.version.end(),
                            [](unsigned char c) { return std::isdigit(c) != 0; }))
        << part.name << " '" << part.version << "'";
  }
}

}  // namespace
}  // namespace forcegrid::tools
