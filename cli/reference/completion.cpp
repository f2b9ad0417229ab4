// SPDX-License-Identifier: Apache-2.0
#include "cli/reference/completion.h"

#include <algorithm>
#include <sstream>
#include <vector>

#include "forcegrid/methods.h"
#include "profiles/device_profile.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::cli {
namespace {

enum class ValueKind { kNone, kWords, kFile, kAny };

struct OfferedOption {
  std::string name;  // "--rate"; empty: an argument without one
  std::string description;
  ValueKind kind = ValueKind::kNone;
  std::vector<std::string> words;
};

// A command, and what may stand behind it.
struct Place {
  std::string path;  // "/chart/accuracy"; empty: the program
  std::string description;
  std::vector<const Command*> subcommands;
  std::vector<OfferedOption> options;
};

bool is_number(const std::string& type) {
  return type.find("INT") != std::string::npos || type.find("FLOAT") != std::string::npos;
}

// The words of a check "{a,b}" at the end of a type's text.
std::vector<std::string> words_of_check(const std::string& type) {
  const std::size_t begin = type.find('{');
  const std::size_t end = type.find('}', begin);
  std::vector<std::string> words;
  if (begin != std::string::npos && end != std::string::npos) {
    std::istringstream list(type.substr(begin + 1, end - begin - 1));
    for (std::string word; std::getline(list, word, ',');) {
      words.push_back(word.substr(std::min(word.find_first_not_of(' '), word.size())));
    }
  }
  return words;
}

// Names that come with the program, for options that mean the same in every command.
std::vector<std::string> names_for(const std::string& path, const std::string& option) {
  if (option == "scene") {
    return simulator::scene_names();
  }
  if (option == "method" || option == "methods" || option == "evaluate") {
    return method_names();
  }
  if (option != "device" && option != "profile") {
    return {};
  }
  std::vector<std::string> names = profiles::available_profiles();
  if (option == "device" && path != "/emulate") {
    for (std::string& name : names) {
      name = "emulated:" + name;
    }
  }
  return names;
}

OfferedOption offered(const Option& option, const std::string& path) {
  OfferedOption out;
  out.name = option.spellings().empty() ? "" : "--" + option.spellings().front();
  const std::string& text = option.description();
  out.description = text.substr(0, text.find_first_of("\n;"));
  if (option.is_flag()) {
    return out;
  }
  if (!option.spellings().empty()) {
    out.words = names_for(path, option.spellings().front());
  }
  if (out.words.empty()) {
    out.words = words_of_check(option.type_text());
  }
  out.kind = !out.words.empty()              ? ValueKind::kWords
             : is_number(option.type_text()) ? ValueKind::kAny
                                             : ValueKind::kFile;
  return out;
}

void collect(const Command& command, const std::string& path, std::vector<Place>& places) {
  Place place;
  place.path = path;
  place.description = command.description();
  for (const std::unique_ptr<Option>& option : command.options()) {
    if (!option->heading().empty()) {
      place.options.push_back(offered(*option, path));
    }
  }
  place.options.push_back({"--help", "Help", ValueKind::kNone, {}});
  for (const std::unique_ptr<Command>& sub : command.subcommands()) {
    place.subcommands.push_back(sub.get());
  }
  places.push_back(std::move(place));
  for (const std::unique_ptr<Command>& sub : command.subcommands()) {
    collect(*sub, path + "/" + sub->name(), places);
  }
}

std::vector<Place> places_of(const Command& program) {
  std::vector<Place> places;
  collect(program, "", places);
  places.front().options.push_back({"--help-all", "Help of every command", ValueKind::kNone, {}});
  places.front().options.push_back({"--version", "Version and commit", ValueKind::kNone, {}});
  return places;
}

// In the shell's single quotes.
std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char letter : text) {
    out += letter == '\'' ? std::string("'\\''") : std::string(1, letter == '\n' ? ' ' : letter);
  }
  return out + "'";
}

// A pattern that matches every command's path.
std::string all_paths(const std::vector<Place>& places) {
  std::string out;
  for (std::size_t i = 1; i < places.size(); ++i) {
    out += (i > 1 ? "|" : "") + places[i].path;
  }
  return out;
}

// The pattern "PATH OPTION" of a case; the program's own options may stand behind any command.
std::string option_pattern(const Place& place, const OfferedOption& option) {
  const std::string pattern = quoted(place.path + " " + option.name);
  return place.path.empty() ? std::string("*").append(pattern) : pattern;
}

constexpr const char* kBashHead =
    R"(# Completion of forcegrid(1) for bash, made by `forcegrid completion bash`.
_forcegrid() {
  local line=${COMP_LINE:0:COMP_POINT} IFS=$' \t\n'
  local -a words
  read -ra words <<<"$line"
  [[ $line == *[[:space:]] ]] && words+=('')
  local -i last=$((${#words[@]} - 1)) i
  local value=${words[last]} option=${words[last - 1]} place='' kind='' candidates=''
  for ((i = 1; i < last; ++i)); do
    case "$place/${words[i]}" in
)";

constexpr const char* kBashMiddle = R"() place+=/${words[i]} ;;
    esac
  done
  if [[ $value == --*=* ]]; then
    option=${value%%=*}
    value=${value#*=}
  elif [[ $value == -* ]]; then
    option=''
  fi
  case "$place $option" in
)";

constexpr const char* kBashTail = R"(  esac
  COMPREPLY=()
  case $kind in
    any) return ;;
    file) compopt -o filenames 2>/dev/null; IFS=$'\n' COMPREPLY=($(compgen -f -- "$value")); return ;;
  esac
  IFS=$'\n'
  COMPREPLY=($(compgen -W "$candidates" -- "$value"))
  # Readline replaces the last part of a word alone.
  if [[ $value == *:* && $COMP_WORDBREAKS == *:* ]]; then
    COMPREPLY=("${COMPREPLY[@]#"${value%"${value##*:}"}"}")
  fi
}
complete -F _forcegrid forcegrid forcegrid-tools
)";

constexpr const char* kZshHead = R"(#compdef forcegrid forcegrid-tools
# Completion of forcegrid(1) for zsh, made by `forcegrid completion zsh`.
_forcegrid() {
  local place='' option=${words[CURRENT - 1]} kind=''
  local -a candidates commands options
  local -i i
  for ((i = 2; i < CURRENT; ++i)); do
    case "$place/${words[i]}" in
)";

constexpr const char* kZshMiddle = R"() place+=/${words[i]} ;;
    esac
  done
  if [[ ${words[CURRENT]} == --*=* ]]; then
    option=${words[CURRENT]%%=*}
    compset -P '*='
  elif [[ ${words[CURRENT]} == -* ]]; then
    option=''
  fi
  case "$place $option" in
)";

constexpr const char* kZshTail = R"(  esac
  case $kind in
    any) _message value ;;
    file) _files ;;
    words) compadd -a candidates ;;
    *)
      (( $#commands )) && _describe command commands
      _describe -o option options
      [[ $kind == arguments ]] && _files
      ;;
  esac
}
if [[ $funcstack[1] == _forcegrid ]]; then
  _forcegrid "$@"
else
  compdef _forcegrid forcegrid forcegrid-tools
fi
)";

std::string bash_words(const std::vector<std::string>& words) {
  std::string out = "$'";
  for (const std::string& word : words) {
    for (const char letter : word + "\n") {
      out += letter == '\n'                     ? std::string("\\n")
             : letter == '\'' || letter == '\\' ? std::string("\\") + letter
                                                : std::string(1, letter);
    }
  }
  return out + "'";
}

bool takes_files(const Place& place) {
  for (const OfferedOption& option : place.options) {
    if (option.name.empty() && option.kind == ValueKind::kFile) {
      return true;
    }
  }
  return false;
}

// Names of commands and options, and the words of an argument, that may stand at a place.
std::vector<std::string> candidates_at(const Place& place, const Place& root) {
  std::vector<std::string> words;
  for (const Command* sub : place.subcommands) {
    words.push_back(sub->name());
  }
  for (const Place* one : {&place, &root}) {
    for (const OfferedOption& option : one->options) {
      if (!option.name.empty()) {
        words.push_back(option.name);
      } else if (one == &place) {
        words.insert(words.end(), option.words.begin(), option.words.end());
      }
    }
    if (&place == &root) {
      break;
    }
  }
  return words;
}

// "name:description" as zsh's _describe reads it.
std::string described(const std::string& name, const std::string& description) {
  std::string escaped;
  for (const char letter : name) {
    escaped += letter == ':' ? std::string("\\:") : std::string(1, letter);
  }
  return quoted(escaped + ":" + description.substr(0, description.find('\n')));
}

std::string zsh_place(const Place& place, const Place& root) {
  std::string out = "    ";
  out.append(quoted(place.path + " ")).append("*)\n");
  std::string commands;
  std::string options;
  for (const Command* sub : place.subcommands) {
    commands.append(" ").append(described(sub->name(), sub->description()));
  }
  for (const Place* one : {&place, &root}) {
    for (const OfferedOption& option : one->options) {
      if (!option.name.empty()) {
        options.append(" ").append(described(option.name, option.description));
      } else if (one == &place) {
        for (const std::string& word : option.words) {
          commands.append(" ").append(described(word, option.description));
        }
      }
    }
    if (&place == &root) {
      break;
    }
  }
  out += "      commands=(" + commands + " )\n      options=(" + options + " )\n";
  return out + (takes_files(place) ? "      kind=arguments\n" : "") + "      ;;\n";
}

}  // namespace

std::string bash_completion(const Command& program) {
  const std::vector<Place> places = places_of(program);
  std::string out = kBashHead + std::string("      ") + all_paths(places) + kBashMiddle;
  for (const Place& place : places) {
    for (const OfferedOption& option : place.options) {
      if (option.name.empty() || option.kind == ValueKind::kNone) {
        continue;
      }
      out += "    " + option_pattern(place, option) + ") ";
      out += option.kind == ValueKind::kFile  ? "kind=file"
             : option.kind == ValueKind::kAny ? "kind=any"
                                              : "candidates=" + bash_words(option.words);
      out += " ;;\n";
    }
  }
  for (const Place& place : places) {
    out += "    " + quoted(place.path + " ") +
           "*) candidates=" + bash_words(candidates_at(place, places.front()));
    if (takes_files(place)) {
      out += "; [[ $value == -* ]] || kind=file";
    }
    out += " ;;\n";
  }
  return out + kBashTail;
}

std::string zsh_completion(const Command& program) {
  const std::vector<Place> places = places_of(program);
  std::string out = kZshHead + std::string("      ") + all_paths(places) + kZshMiddle;
  for (const Place& place : places) {
    for (const OfferedOption& option : place.options) {
      if (option.name.empty() || option.kind == ValueKind::kNone) {
        continue;
      }
      out += "    " + option_pattern(place, option) + ") ";
      if (option.kind == ValueKind::kWords) {
        out += "kind=words; candidates=(";
        for (const std::string& word : option.words) {
          out.append(" ").append(quoted(word));
        }
        out += " )";
      } else {
        out += option.kind == ValueKind::kFile ? "kind=file" : "kind=any";
      }
      out += " ;;\n";
    }
  }
  for (const Place& place : places) {
    out += zsh_place(place, places.front());
  }
  return out + kZshTail;
}

}  // namespace forcegrid::cli
