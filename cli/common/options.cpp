// SPDX-License-Identifier: Apache-2.0
#include "cli/common/options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <utility>

#include "cli/common/help_columns.h"

namespace forcegrid::cli {
namespace {

// CLI11's own help, wrapped.
class WrappedFormatter : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override {
    const std::string help = CLI::Formatter::make_help(app, std::move(name), mode);
    // The help of a subcommand becomes part of another one, which is wrapped as a whole.
    return mode == CLI::AppFormatMode::Sub ? help : wrapped_help(help, get_column_width());
  }
};

}  // namespace

const char* options_library_version() { return CLI11_VERSION; }

Check one_of(const std::vector<std::string>& words) {
  const std::string form = "{" + CLI::detail::join(words, ",") + "}";
  return {[words, form](const std::string& value) {
            return std::find(words.begin(), words.end(), value) != words.end()
                       ? std::string()
                       : value + " not in " + form;
          },
          form};
}

Option* Option::required() {
  option_.required();
  return this;
}

Option* Option::check(const Check& check) {
  option_.check(CLI::Validator(
      [problem = check.problem](std::string& value) { return problem(value); }, check.form));
  return this;
}

Option* Option::type_name(const std::string& text) {
  option_.type_name(text);
  return this;
}

Option* Option::show_default() {
  option_.capture_default_str();
  return this;
}

Option* Option::show_default(const std::string& text) {
  option_.default_str(text);
  return this;
}

Option* Option::values(int count) {
  option_.expected(count);
  return this;
}

Option* Option::repeatable() {
  option_.expected(1)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  return this;
}

Option* Option::separated_by(char delimiter) {
  option_.delimiter(delimiter);
  return this;
}

Option* Option::not_in_config() {
  option_.configurable(false);
  return this;
}

Option* Option::needs(Option* other) {
  option_.needs(&other->option_);
  return this;
}

Option* Option::excludes(Option* other) {
  option_.excludes(&other->option_);
  return this;
}

void Option::preset(const std::vector<std::string>& texts) {
  try {
    for (const std::string& text : texts) {
      option_.add_result(text);
    }
    option_.run_callback();
    option_.clear();
  } catch (const CLI::Error& error) {
    throw OptionError(error.what());
  }
  option_.required(false);
  option_.default_str(takes_several() ? "[" + CLI::detail::join(texts, ",") + "]" : texts.front());
}

bool Option::given() const { return option_.count() > 0; }

const std::vector<std::string>& Option::spellings() const { return option_.get_lnames(); }

const std::string& Option::description() const { return option_.get_description(); }

const std::string& Option::heading() const { return option_.get_group(); }

std::string Option::positional_name() const {
  return spellings().empty() ? option_.get_name() : std::string();
}

bool Option::is_required() const { return option_.get_required(); }

std::string Option::type_text() const { return option_.get_type_name(); }

std::string Option::default_text() const { return option_.get_default_str(); }

std::vector<std::string> Option::default_texts() const {
  std::string text = default_text();
  if (takes_several() && text.size() >= 2 && text.front() == '[') {
    text = text.substr(1, text.size() - 2);  // CLI11 writes the default of a list as "[a,b]"
  }
  if (text.empty()) {
    return {};
  }
  return takes_several() ? CLI::detail::split(text, ',') : std::vector<std::string>{text};
}

bool Option::is_flag() const { return option_.get_items_expected_max() == 0; }

bool Option::takes_several() const { return option_.get_items_expected_max() > 1; }

bool Option::is_in_config() const { return option_.get_configurable() && !spellings().empty(); }

Command& Command::add_subcommand(const std::string& name, const std::string& description) {
  subcommands_.push_back(std::make_unique<Command>(*app_.add_subcommand(name, description)));
  return *subcommands_.back();
}

void Command::require_subcommand() { app_.require_subcommand(1); }

Option* Command::keep(CLI::Option* option) {
  options_.push_back(std::make_unique<Option>(*option));
  return options_.back().get();
}

template <typename T>
Option* Command::add_value(const std::string& names, T& variable, const std::string& description) {
  return keep(app_.add_option(names, variable, description));
}

template Option* Command::add_value(const std::string&, std::string&, const std::string&);
template Option* Command::add_value(const std::string&, double&, const std::string&);
template Option* Command::add_value(const std::string&, int&, const std::string&);
template Option* Command::add_value(const std::string&, unsigned&, const std::string&);
template Option* Command::add_value(const std::string&, std::int64_t&, const std::string&);
template Option* Command::add_value(const std::string&, std::uint64_t&, const std::string&);
template Option* Command::add_value(const std::string&, std::optional<std::string>&,
                                    const std::string&);
template Option* Command::add_value(const std::string&, std::optional<double>&, const std::string&);
template Option* Command::add_value(const std::string&, std::optional<int>&, const std::string&);
template Option* Command::add_value(const std::string&, std::vector<std::string>&,
                                    const std::string&);
template Option* Command::add_value(const std::string&, std::vector<double>&, const std::string&);
template Option* Command::add_value(const std::string&, std::vector<int>&, const std::string&);
template Option* Command::add_value(const std::string&, std::vector<std::uint64_t>&,
                                    const std::string&);
template Option* Command::add_value(const std::string&, std::array<double, 3>&, const std::string&);
template Option* Command::add_value(const std::string&, std::array<int, 3>&, const std::string&);

Option* Command::add_flag(const std::string& name, bool& variable, const std::string& description) {
  return keep(app_.add_flag(name, variable, description));
}

Option* Command::add_optional_value(const std::string& name,
                                    std::function<void(const std::optional<std::string>&)> take,
                                    const std::string& description) {
  CLI::Option* const option = app_.add_option_function<std::vector<std::string>>(
      name,
      [take = std::move(take)](const std::vector<std::string>& values) {
        // CLI11 gives "{}" or an empty word for no value.
        const bool none = values.empty() || values.front().empty() || values.front() == "{}";
        take(none ? std::nullopt : std::optional(values.front()));
      },
      description);
  option->expected(0, 1)->trigger_on_parse();
  return keep(option);
}

void Command::remove_option(const std::string& name) {
  CLI::Option* const option = app_.get_option(name);
  std::erase_if(options_, [option](const auto& own) { return &own->option_ == option; });
  app_.remove_option(option);
}

void Command::begin_group(const std::string& heading) { app_.option_defaults()->group(heading); }

void Command::footer(const std::string& text) { app_.footer(text); }

void Command::callback(std::function<void()> done) {
  app_.callback([done = std::move(done)] {
    try {
      done();
    } catch (const OptionError& error) {
      throw CLI::ParseError(error.what(), CLI::ExitCodes::ValidationError);
    }
  });
}

std::string Command::name() const { return app_.get_name(); }

std::string Command::description() const { return app_.get_description(); }

std::string Command::footer() const { return app_.get_footer(); }

Command& Command::subcommand(const std::string& name) const {
  for (const std::unique_ptr<Command>& one : subcommands_) {
    if (one->name() == name) {
      return *one;
    }
  }
  throw std::out_of_range("no command " + name);
}

Option* Command::find_option(const std::string& spelling) const {
  for (const std::unique_ptr<Option>& one : options_) {
    const std::vector<std::string>& spellings = one->spellings();
    if (std::find(spellings.begin(), spellings.end(), spelling) != spellings.end()) {
      return one.get();
    }
  }
  return nullptr;
}

bool Command::given() const { return app_.parsed(); }

bool Command::given(const std::string& option) const { return app_.count(option) > 0; }

std::string Command::settings_text() const { return app_.config_to_str(true); }

namespace detail {

AppOwner::AppOwner(const std::string& description, const std::string& name,
                   const std::string& version)
    : owned_app(std::make_unique<CLI::App>(description, name)) {
  // Subcommands inherit what is set before they are added.
  owned_app->formatter(std::make_shared<WrappedFormatter>());
  owned_app->fallthrough();
  owned_app->set_version_flag("--version", version);
  owned_app->set_help_all_flag("--help-all", "Help of every command");
  owned_app->require_subcommand(0, 1);  // a misspelt one is named
}

AppOwner::~AppOwner() = default;

}  // namespace detail

Program::Program(const std::string& description, const std::string& name,
                 const std::string& version)
    : detail::AppOwner(description, name, version), Command(*owned_app) {}

std::optional<int> Program::parse(int argc, const char* const* argv) {
  try {
    app().parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app().exit(error) == 0 ? 0 : 2;
  }
  return std::nullopt;
}

}  // namespace forcegrid::cli
