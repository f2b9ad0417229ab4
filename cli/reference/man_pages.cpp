// SPDX-License-Identifier: Apache-2.0
#include "cli/reference/man_pages.h"

#include <algorithm>
#include <cctype>
#include <sstream>
#include <vector>

namespace forcegrid::cli {
namespace {

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::toupper(letter)); });
  return text;
}

// Text as troff reads it: a backslash or a hyphen stands for itself, and no line is a request.
std::string escaped(const std::string& text) {
  std::string out;
  bool begins_line = true;
  for (const char letter : text) {
    if (begins_line && (letter == '.' || letter == '\'')) {
      out += "\\&";
    }
    if (letter == '\\') {
      out += "\\e";
    } else if (letter == '-') {
      out += "\\-";
    } else {
      out += letter;
    }
    begins_line = letter == '\n';
  }
  return out;
}

// Line by line, as they are.
std::string as_it_stands(const std::string& text) { return ".nf\n" + escaped(text) + "\n.fi\n"; }

// A paragraph. Its line breaks stay, and indented lines are not filled: they are lists.
std::string paragraph(const std::string& text) {
  std::istringstream lines(text);
  std::string out;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(' ')) {
      out += as_it_stands(line);
    } else {
      out += (out.empty() ? "" : ".br\n") + (line.empty() ? "\\&" : escaped(line)) + "\n";
    }
  }
  return out;
}

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

std::string option_text(const Option& option) {
  std::string out = ".TP\n";
  if (option.spellings().empty()) {
    out += "\\fI" + escaped(option.positional_name()) + "\\fR\n";
  } else {
    out += "\\fB\\-\\-" + escaped(option.spellings().front()) + "\\fR";
    if (!option.is_flag()) {
      out += " \\fI" + escaped(option.type_text()) + "\\fR";
    }
    out += "\n";
  }
  out += paragraph(option.description());
  if (option.is_required()) {
    out += ".br\nRequired.\n";
  }
  if (!option.is_flag() && !option.default_text().empty()) {
    out += ".br\nDefault: " + escaped(option.default_text()) + "\n";
  }
  return out;
}

// The options under their headings, `macro` being that of a heading.
std::string options_text(const Command& command) {
  std::string out;
  std::vector<std::string> headings;
  for (const std::unique_ptr<Option>& option : command.options()) {
    const std::string heading =
        option->spellings().empty() ? std::string("Arguments") : option->heading();
    if (!heading.empty() &&
        std::find(headings.begin(), headings.end(), heading) == headings.end()) {
      headings.push_back(heading);
    }
  }
  for (const std::string& heading : headings) {
    out += ".SS \"" + escaped(heading) + "\"\n";
    for (const std::unique_ptr<Option>& option : command.options()) {
      if ((option->spellings().empty() ? "Arguments" : option->heading()) == heading) {
        out += option_text(*option);
      }
    }
  }
  return out;
}

std::string synopsis(const Command& command, const std::string& name) {
  std::string out = ".B " + escaped(name) + "\n";
  if (!command.subcommands().empty()) {
    out += ".I COMMAND\n";
  }
  out += "[\\fIOPTION\\fR ...]";
  for (const std::unique_ptr<Option>& option : command.options()) {
    if (option->spellings().empty()) {
      const std::string word = "\\fI" + escaped(option->positional_name()) + "\\fR";
      out += " " + (option->is_required() ? word : "[" + word + "]");
    }
  }
  return out + "\n";
}

std::string page_head(const std::string& page, const std::string& version,
                      const std::string& description) {
  return ".TH " + upper(escaped(page)) + " 1 \"\" \"forcegrid " + version +
         "\" \"Forcegrid\"\n.ad l\n.SH NAME\n" + escaped(page) + " \\- " +
         escaped(first_line(description)) + "\n";
}

std::string see_also(const std::vector<std::string>& pages) {
  std::string out = ".SH SEE ALSO\n";
  for (std::size_t i = 0; i < pages.size(); ++i) {
    out += ".BR " + escaped(pages[i]) + " (1)" + (i + 1 < pages.size() ? "," : "") + "\n";
  }
  return out;
}

// What a command does and which options it has; a sub-command's headings are within its section.
std::string body(const Command& command, const std::string& name) {
  std::string out = ".SH SYNOPSIS\n" + synopsis(command, name);
  for (const std::unique_ptr<Command>& sub : command.subcommands()) {
    out += ".br\n" + synopsis(*sub, name + " " + sub->name());
  }
  out += ".SH DESCRIPTION\n" + paragraph(command.description());
  if (!command.footer().empty()) {
    out += ".PP\n" + as_it_stands(command.footer());
  }
  if (!command.options().empty()) {
    out += ".SH OPTIONS\n" + options_text(command);
  }
  for (const std::unique_ptr<Command>& sub : command.subcommands()) {
    out += ".SH " + upper(escaped(name + " " + sub->name())) + "\n" + paragraph(sub->description());
    out += options_text(*sub);
    if (!sub->footer().empty()) {
      out += ".PP\n" + as_it_stands(sub->footer());
    }
  }
  return out;
}

constexpr const char* kFiles = R"(.SH FILES
.TP
.I /etc/forcegrid/config.toml
Options for everybody at this machine.
.TP
.I $XDG_CONFIG_HOME/forcegrid/config.toml
Options of one person, by default in
.IR ~/.config .
A file here counts more than the one above, one that
.B \-\-config
names more than both, and the command line most.
.B forcegrid config
shows all keys and where each value comes from.
.TP
.I $XDG_CONFIG_HOME/forcegrid/devices/*.toml
What
.B forcegrid calibrate
measured of each device.
.SH ENVIRONMENT
.TP
.BR FORCEGRID_LOG_LEVEL ", " FORCEGRID_LOG_FILE ", " FORCEGRID_LOG_FORMAT ", " FORCEGRID_QUIET
As the options of these names, which count more.
.TP
.BR FORCEGRID_PROFILE_PATH ", " FORCEGRID_SCENE_PATH
Folders of device profiles and of scenes, separated by colons, that are searched first.
.TP
.B NO_COLOR
If it is set, messages have no colour.
.SH EXIT STATUS
.TP
.B 0
As asked.
.TP
.B 1
A fault, which standard error names.
.TP
.B 2
The command line or the configuration can't be used.
.TP
.B 3
Emergency stop.
.TP
.B 4
No simulator answered, or it was lost.
.TP
.B 128 + N
Ended by signal N: 130 after Ctrl-C, 143 after SIGTERM.
)";

std::string program_page(const Command& program, const std::string& version) {
  const std::string name = program.name();
  std::string out = page_head(name, version, program.description());
  out += ".SH SYNOPSIS\n" + synopsis(program, name);
  out += ".SH DESCRIPTION\n" + paragraph(program.description() + ".");
  out +=
      ".PP\nEach command has a manual page of its own, and tells its options with\n"
      ".BR \\-\\-help .\n";
  out += ".SH COMMANDS\n";
  for (const std::unique_ptr<Command>& sub : program.subcommands()) {
    out += ".TP\n.B " + escaped(sub->name()) + "\n" + paragraph(sub->description());
  }
  out +=
      ".SH OPTIONS\n.TP\n.B \\-\\-help\nHelp; behind a command, of that command.\n"
      ".TP\n.B \\-\\-help\\-all\nHelp of every command.\n"
      ".TP\n.B \\-\\-version\nVersion and commit.\n";
  for (const std::unique_ptr<Option>& option : program.options()) {
    if (!option->heading().empty()) {
      out += option_text(*option);
    }
  }
  out += kFiles;
  std::vector<std::string> others;
  for (const std::unique_ptr<Command>& sub : program.subcommands()) {
    others.push_back(name + "-" + sub->name());
  }
  return out + see_also(others);
}

// The same commands under the name of the program that has them all.
std::string tools_page(const std::string& version) {
  return page_head("forcegrid-tools", version, "charts, tuning and calibration of Forcegrid") +
         ".SH SYNOPSIS\n.B forcegrid\\-tools\n.I COMMAND\n[\\fIOPTION\\fR ...]\n.SH DESCRIPTION\n"
         "Has all commands of\n.BR forcegrid (1),\nwhich becomes this program for the commands "
         "that a run does not need.\nNobody has to call it by its own name.\n" +
         see_also({"forcegrid"});
}

}  // namespace

std::map<std::string, std::string> man_pages(const Command& program, const std::string& version) {
  std::map<std::string, std::string> pages;
  const std::string name = program.name();
  pages[name + ".1"] = program_page(program, version);
  pages["forcegrid-tools.1"] = tools_page(version);
  for (const std::unique_ptr<Command>& command : program.subcommands()) {
    const std::string page = name + "-" + command->name();
    pages[page + ".1"] = page_head(page, version, command->description()) +
                         body(*command, name + " " + command->name()) + see_also({name});
  }
  return pages;
}

}  // namespace forcegrid::cli
