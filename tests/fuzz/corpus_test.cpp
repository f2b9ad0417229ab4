// SPDX-License-Identifier: Apache-2.0
// Plays the kept inputs to the targets: seeds, and whatever once was a fault.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "tests/fuzz/fuzz_targets.h"

namespace forcegrid::fuzz {
namespace {

struct Target {
  const char* name;
  void (*feed)(Input);
};

class FuzzCorpus : public testing::TestWithParam<Target> {};

TEST_P(FuzzCorpus, IsWithstoodWholeCutAndMutated) {
  const std::filesystem::path folder =
      std::filesystem::path(FORCEGRID_SOURCE_DIR) / "tests/fuzz/corpus" / GetParam().name;
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  ASSERT_FALSE(files.empty()) << folder;
  constexpr unsigned kSeed = 20250301;
  std::mt19937 random(kSeed);
  for (const auto& file : files) {
    SCOPED_TRACE(file.string() + ", seed " + std::to_string(kSeed));
    std::ifstream stream(file, std::ios::binary);
    const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(stream), {}};
    GetParam().feed(bytes);
    GetParam().feed(Input(bytes).first(bytes.size() / 2));
    for (int i = 0; i < 4 && !bytes.empty(); ++i) {
      std::vector<std::uint8_t> mutated = bytes;
      mutated[random() % mutated.size()] ^= static_cast<std::uint8_t>(1U << (random() % 8));
      GetParam().feed(mutated);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Targets, FuzzCorpus,
    testing::Values(Target{"usbip_server", usbip_server}, Target{"usbip_client", usbip_client},
                    Target{"w2_report", w2_report}, Target{"device_profile", device_profile},
                    Target{"link_datagram", link_datagram},
                    Target{"sealed_datagram", sealed_datagram},
                    Target{"view_streams", view_streams}, Target{"view_command", view_command}),
    [](const auto& target) { return target.param.name; });

}  // namespace
}  // namespace forcegrid::fuzz
