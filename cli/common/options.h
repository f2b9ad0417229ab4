// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace forcegrid::cli {

/// The command line, read by CLI11. Its headers take five to eight seconds to compile, so that one
/// source includes them and every command describes its options with the classes below.

/// A value on the command line or in the configuration that can't be used.
class OptionError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What a value has to be.
struct Check {
  /// Returns what is wrong with the value and what to give instead; empty: nothing.
  std::function<std::string(const std::string& value)> problem;
  std::string form{};  ///< for the help: "1..10", "{a,b}"
};

/// Version of CLI11.
const char* options_library_version();

/// Accepts one of the words.
Check one_of(const std::vector<std::string>& words);

/// One option, flag or positional argument. All functions that change it return it, so that they
/// chain. It belongs to its Command. Threads: one.
class Option {
 public:
  explicit Option(CLI::Option& option) : option_(option) {}

  Option* required();
  /// Each value has to pass; several checks all count.
  Option* check(const Check& check);
  /// The value's type and unit in the help and in docs/config.md: "FLOAT Hz", "[FILE]".
  Option* type_name(const std::string& text);
  /// The help shows the variable's present value as the default.
  Option* show_default();
  /// The help shows `text` as the default.
  Option* show_default(const std::string& text);
  /// So many values belong to one mention.
  Option* values(int count);
  /// It takes one value and may be repeated.
  Option* repeatable();
  /// One word may hold several values.
  Option* separated_by(char delimiter);
  /// No key of the configuration file sets it.
  Option* not_in_config();
  Option* needs(Option* other);
  Option* excludes(Option* other);

  /// Sets it as the configuration file does: the command line may still give another value.
  /// @throws OptionError if a value can't be used.
  void preset(const std::vector<std::string>& texts);

  [[nodiscard]] bool given() const;  ///< on the command line
  /// Long spellings without dashes, the current one first, deprecated ones behind it; none: it is
  /// positional.
  [[nodiscard]] const std::vector<std::string>& spellings() const;
  [[nodiscard]] const std::string& description() const;
  /// The heading of the help that it stands under.
  [[nodiscard]] const std::string& heading() const;
  /// Its name if it is positional, else empty.
  [[nodiscard]] std::string positional_name() const;
  [[nodiscard]] bool is_required() const;
  /// Type, unit and form of its checks: "FLOAT Hz:100..4000".
  [[nodiscard]] std::string type_text() const;
  [[nodiscard]] std::string default_text() const;
  [[nodiscard]] std::vector<std::string> default_texts() const;  ///< one for each value
  [[nodiscard]] bool is_flag() const;
  [[nodiscard]] bool takes_several() const;
  [[nodiscard]] bool is_in_config() const;

 private:
  friend class Command;
  CLI::Option& option_;
};

/// Types that an option's variable may have.
template <typename T, typename... Types>
inline constexpr bool kIsOneOf = (std::is_same_v<T, Types> || ...);
template <typename T>
inline constexpr bool kIsOptionValue =
    kIsOneOf<T, std::string, double, int, unsigned, std::int64_t, std::uint64_t,
             std::optional<std::string>, std::optional<double>, std::optional<int>,
             std::vector<std::string>, std::vector<double>, std::vector<int>,
             std::vector<std::uint64_t>, std::array<double, 3>, std::array<int, 3>>;

/// A command with its options and sub-commands. Threads: one.
class Command {
 public:
  explicit Command(CLI::App& app) : app_(app) {}
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;
  virtual ~Command() = default;

  Command& add_subcommand(const std::string& name, const std::string& description);
  /// One of its sub-commands has to be given.
  void require_subcommand();

  /// @param names        "--rate", "--rate,--old-spelling", or "FILE" of a positional argument
  /// @param variable     gets the value; a vector takes several values. It outlives the command.
  template <typename T>
  Option* add_option(const std::string& names, T& variable, const std::string& description) {
    static_assert(kIsOptionValue<T>, "add this type to kIsOptionValue and to options.cpp");
    return add_value(names, variable, description);
  }
  Option* add_flag(const std::string& name, bool& variable, const std::string& description);
  /// An option that may be given with or without a value. `take` gets the value, or nothing.
  Option* add_optional_value(const std::string& name,
                             std::function<void(const std::optional<std::string>&)> take,
                             const std::string& description);
  void remove_option(const std::string& name);
  /// The options that are added from now on stand under this heading of the help.
  void begin_group(const std::string& heading);
  void footer(const std::string& text);
  /// Called once the command line is read and has this command. It may throw OptionError.
  void callback(std::function<void()> done);

  [[nodiscard]] std::string name() const;
  [[nodiscard]] std::string description() const;
  [[nodiscard]] std::string footer() const;
  /// In the order in which they were added.
  [[nodiscard]] const std::vector<std::unique_ptr<Command>>& subcommands() const {
    return subcommands_;
  }
  [[nodiscard]] const std::vector<std::unique_ptr<Option>>& options() const { return options_; }
  /// @throws std::out_of_range if there is none.
  [[nodiscard]] Command& subcommand(const std::string& name) const;
  /// Null: there is none.
  [[nodiscard]] Option* find_option(const std::string& spelling) const;
  /// Whether the command line has this command, or this option of it.
  [[nodiscard]] bool given() const;
  [[nodiscard]] bool given(const std::string& option) const;
  /// All options and their values, as TOML.
  [[nodiscard]] std::string settings_text() const;

 protected:
  CLI::App& app() const { return app_; }

 private:
  template <typename T>
  Option* add_value(const std::string& names, T& variable, const std::string& description);
  Option* keep(CLI::Option* option);

  CLI::App& app_;
  std::vector<std::unique_ptr<Command>> subcommands_;
  std::vector<std::unique_ptr<Option>> options_;
};

namespace detail {
/// Owns CLI11's object, which a base class behind it needs first.
struct AppOwner {
  AppOwner(const std::string& description, const std::string& name, const std::string& version);
  ~AppOwner();
  AppOwner(const AppOwner&) = delete;
  AppOwner& operator=(const AppOwner&) = delete;

  std::unique_ptr<CLI::App> owned_app;
};
}  // namespace detail

/// The program: --help, --help-all, --version, and its commands, whose options may also follow
/// those of a sub-command.
class Program : private detail::AppOwner, public Command {
 public:
  Program(const std::string& description, const std::string& name, const std::string& version);

  /// Reads the command line and calls the callbacks. Help, version and what can't be used are
  /// printed.
  /// @returns nothing if all is well, else the exit status: 0 after a help, 2 after an error.
  std::optional<int> parse(int argc, const char* const* argv);
};

}  // namespace forcegrid::cli
