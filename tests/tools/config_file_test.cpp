// SPDX-License-Identifier: Apache-2.0
#include "tools/config_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <unistd.h>

#include <fstream>
#include <optional>
#include <string>

namespace forcegrid::tools {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string file_with(const std::string& text) {
  const std::string file =
      ::testing::TempDir() + "config_file_" + std::to_string(getpid()) + ".toml";
  std::ofstream(file) << text;
  return file;
}

std::string complaint_about(const std::string& text) {
  try {
    static_cast<void>(read_config_file(file_with(text)));
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "nothing";
}

// An environment variable for as long as it lives.
class Environment {
 public:
  Environment(std::string name, const char* value) : name_(std::move(name)) {
    if (const char* const old = getenv(name_.c_str())) {
      old_ = old;
    }
    value == nullptr ? unsetenv(name_.c_str()) : setenv(name_.c_str(), value, 1);
  }
  ~Environment() { old_ ? setenv(name_.c_str(), old_->c_str(), 1) : unsetenv(name_.c_str()); }

 private:
  std::string name_;
  std::optional<std::string> old_;
};

TEST(ConfigFile, FlattensTablesAndKeepsLines) {
  const auto values = read_config_file(
      file_with("[run]\nrate = 500\nscene = \"small\"\n\n[chart.accuracy]\nquick = true\n"
                "scenes = [\"a\", \"b\"]\nsome = [1, 2.5]\n"));
  ASSERT_EQ(values.size(), 5u);
  EXPECT_EQ(values[0].key, "run.rate");
  EXPECT_EQ(values[0].line, 2u);
  EXPECT_EQ(values[0].type, ConfigType::kInteger);
  EXPECT_THAT(values[0].texts, ElementsAre("500"));
  EXPECT_EQ(values[1].type, ConfigType::kText);
  EXPECT_EQ(values[2].key, "chart.accuracy.quick");
  EXPECT_EQ(values[2].type, ConfigType::kBoolean);
  EXPECT_TRUE(values[3].is_array);
  EXPECT_THAT(values[3].texts, ElementsAre("a", "b"));
  EXPECT_EQ(values[4].type, ConfigType::kNumber);  // one number among integers
  EXPECT_THAT(values[4].texts, ElementsAre("1", "2.5"));
}

TEST(ConfigFile, NamesLineAndKeyOfWhatItCantUse) {
  EXPECT_THAT(complaint_about("[run]\na = [1, \"x\"]\n"), HasSubstr(":2: key 'run.a'"));
  EXPECT_THAT(complaint_about("[run]\na = [[1]]\n"), HasSubstr(":2: key 'run.a'"));
  EXPECT_THAT(complaint_about("a = 1979-05-27\n"), HasSubstr(":1: key 'a'"));
  EXPECT_THAT(complaint_about("[[run]]\na = 1\n"), HasSubstr("key 'run'"));
  EXPECT_THAT(complaint_about("\n\na = \n"), HasSubstr(":3:"));
  EXPECT_THAT(complaint_about("a = \"\xc3\xa9\"\n"), HasSubstr("ASCII"));
}

TEST(ConfigFile, LayersFollowTheXdgSpecification) {
  const Environment home("HOME", "/home/someone");
  {
    const Environment xdg("XDG_CONFIG_HOME", "/elsewhere");
    const auto layers = config_layers("mine.toml");
    ASSERT_EQ(layers.size(), 3u);
    EXPECT_EQ(layers[0].file, "/etc/forcegrid/config.toml");
    EXPECT_EQ(layers[1].file, "/elsewhere/forcegrid/config.toml");
    EXPECT_EQ(layers[2].file, "mine.toml");
    EXPECT_FALSE(layers[1].required);
    EXPECT_TRUE(layers[2].required);
  }
  for (const char* unusable : {static_cast<const char*>(nullptr), "", "relative"}) {
    const Environment xdg("XDG_CONFIG_HOME", unusable);
    const auto layers = config_layers("");
    ASSERT_EQ(layers.size(), 2u);
    EXPECT_EQ(layers[1].file, "/home/someone/.config/forcegrid/config.toml");
  }
}

TEST(ConfigFile, WritesWhatItReads) {
  const std::string text = "quote \" backslash \\";
  const auto values =
      read_config_file(file_with("a = " + toml_text({text, "b"}, ConfigType::kText, true) +
                                 "\nc = " + toml_text({"0.1"}, ConfigType::kNumber, false) + "\n"));
  ASSERT_EQ(values.size(), 2u);
  EXPECT_THAT(values[0].texts, ElementsAre(text, "b"));
  EXPECT_THAT(values[1].texts, ElementsAre("0.1"));
}

}  // namespace
}  // namespace forcegrid::tools
