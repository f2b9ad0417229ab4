// SPDX-License-Identifier: Apache-2.0
#include "tools/doctor_report.h"

#include <pwd.h>
#include <sodium.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <utility>

#include "driver/sysfs_file.h"

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;

constexpr char kHead[] =
    "# Bring-up report\n"
    "\n"
    "`forcegrid doctor --report` wrote this form. It contains: versions of the program, the kernel "
    "and\n"
    "the libraries; findings about this computer; measured wake-ups; vendor and product numbers, "
    "USB\n"
    "ports, firmware and descriptor hashes of attached haptic devices. It leaves out serial "
    "numbers,\n"
    "user and host names, folders of your home, and addresses. Read it before you send it.\n"
    "\n"
    "Complete the blanks (`____`) as far as you got with docs/bring_up.md. Then attach this file "
    "to "
    "a\n"
    "new issue in the issue tracker of the project from which you have the program.\n";

constexpr char kBlanks[] =
    "## What only you can see\n"
    "\n"
    "Leave a blank as it is where you did not get that far. Name no person and no serial number.\n"
    "\n"
    "### The device\n"
    "\n"
    "| question | answer |\n"
    "|---|---|\n"
    "| maker, model, year | ____ |\n"
    "| changes made to it (motors, amplifiers, gears, handle) | ____ |\n"
    "| firmware: version, or where its file is from | ____ |\n"
    "| amplifiers: type and current limit | ____ |\n"
    "| power supply: voltage and largest current | ____ |\n"
    "| power switch within reach of a hand? | ____ |\n"
    "| profile used | ____ |\n"
    "\n"
    "### Positions against a ruler (motor power off)\n"
    "\n"
    "| direction of the hand | by the ruler, mm | by the program, mm | right direction? |\n"
    "|---|---|---|---|\n"
    "| toward you (+x) | ____ | ____ | ____ |\n"
    "| to your right (+y) | ____ | ____ | ____ |\n"
    "| up (+z) | ____ | ____ | ____ |\n"
    "| back to the start | 0 | ____ | |\n"
    "\n"
    "### Motors\n"
    "\n"
    "| question | joint a | joint b | joint c |\n"
    "|---|---|---|---|\n"
    "| counts grow in the direction that `calibrate` expects? | ____ | ____ | ____ |\n"
    "| first push of the motor check: seen, felt, direction | ____ | ____ | ____ |\n"
    "| `calibrate --dry-run`: torque constant, Nm/A | ____ | ____ | ____ |\n"
    "| `calibrate --dry-run`: Coulomb friction, Nm | ____ | ____ | ____ |\n"
    "| temperature of the motor after 5 minutes | ____ | ____ | ____ |\n"
    "\n"
    "### Steps of docs/bring_up.md\n"
    "\n"
    "| step | reached? | what differed from the page |\n"
    "|---|---|---|\n"
    "| force limit at a tenth | ____ | ____ |\n"
    "| one joint | ____ | ____ |\n"
    "| one spring | ____ | ____ |\n"
    "| full force | ____ | ____ |\n"
    "| emergency stop by key: time until the motors were free | ____ | ____ |\n"
    "| cable pulled: time until the motors were free | ____ | ____ |\n"
    "\n"
    "### Anything else\n"
    "\n"
    "____\n";

// The measured checks that go to an address, whose texts may name it.
constexpr std::array<const char*, 2> kAddressed{"USB round trip", "simulator's round trip"};

std::string content_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::string sha256(const std::string& bytes) {
  std::array<unsigned char, crypto_hash_sha256_BYTES> hash{};
  crypto_hash_sha256(hash.data(), reinterpret_cast<const unsigned char*>(bytes.data()),
                     bytes.size());
  std::string text;
  for (const unsigned char byte : hash) {
    char digits[3];
    std::snprintf(digits, sizeof digits, "%02x", byte);
    text += digits;
  }
  return text;
}

std::string hash_of(const fs::path& file) {
  const std::string bytes = content_of(file);
  return bytes.empty() ? "not readable"
                       : std::to_string(bytes.size()) + " bytes, SHA-256 " + sha256(bytes);
}

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool of_word(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0; }

void add(PrivateWords& words, const std::string& word, const std::string& in_its_place) {
  static const std::array<std::string, 6> kOfEveryone{"",  "root",   "localhost",
                                                      "/", "(none)", "none"};
  if (std::find(kOfEveryone.begin(), kOfEveryone.end(), lower(word)) == kOfEveryone.end()) {
    words.emplace(word, in_its_place);
  }
}

void add_host(PrivateWords& words, const std::string& host) {
  add(words, host, "(host)");
  add(words, host.substr(0, host.find('.')), "(host)");  // and without its domain
}

std::string environment(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

// A cell of a table: nothing that ends it.
std::string cell(std::string text) {
  for (char& c : text) {
    c = c == '|' ? '/' : c == '\n' ? ' ' : c;
  }
  return text;
}

class Form {
 public:
  explicit Form(const PrivateWords& words) : words_(words) {}

  void fixed(const std::string& text) { text_ += text; }
  void row(const std::vector<std::string>& cells) {
    text_ += "|";
    for (const std::string& one : cells) {
      text_.append(" ").append(cell(without_private_words(one, words_))).append(" |");
    }
    text_ += "\n";
  }
  void head(const std::vector<std::string>& names) {
    std::string line = "|";
    std::string rule = "|";
    for (const std::string& name : names) {
      line.append(" ").append(name).append(" |");
      rule += "---|";
    }
    text_ += line + "\n" + rule + "\n";
  }
  const std::string& text() const { return text_; }

 private:
  const PrivateWords& words_;
  std::string text_;
};

void write_versions(const std::vector<PartVersion>& versions, Form& form) {
  form.fixed("\n## Versions\n\n");
  form.head({"part", "version"});
  for (const PartVersion& part : versions) {
    form.row({part.name, part.version});
  }
}

bool addressed(const Finding& finding) {
  return std::find(kAddressed.begin(), kAddressed.end(), finding.check) != kAddressed.end();
}

void write_findings(const std::vector<Finding>& findings, Form& form) {
  form.fixed("\n## Findings\n\n");
  form.head({"check", "verdict", "what"});
  for (const Finding& finding : findings) {
    if (finding.check == "versions" || finding.check.rfind("device at ", 0) == 0) {
      continue;  // in tables of their own
    }
    const bool names_address = addressed(finding) && finding.measured.empty();
    form.row(
        {finding.check, to_string(finding.verdict), names_address ? "not measured" : finding.what});
  }
  for (const Finding& finding : findings) {
    if (finding.measured.empty()) {
      continue;
    }
    form.fixed("\n### Measured: " + finding.check + "\n\n```\n");
    for (const auto& [name, value] : finding.measured) {
      char line[80];
      std::snprintf(line, sizeof line, "%-16s %.6g\n", name.c_str(), value);
      form.fixed(line);
    }
    for (const std::string& line : histogram_lines(finding.histogram)) {
      form.fixed(line + "\n");
    }
    form.fixed("```\n");
  }
}

void write_device(const FoundDevice& device, const SurveyRoots& roots, Form& form) {
  char ids[16];
  std::snprintf(ids, sizeof ids, "%04x:%04x", device.vendor_id, device.product_id);
  form.fixed(std::string("\n### ") + ids + "\n\n");
  form.head({"property", "value"});
  form.row({"names", device.manufacturer + " " + device.product});
  form.row({"bus, port", device.bus + ", " + device.port_path});
  form.row({"firmware", device.firmware});
  std::string profiles;
  for (const std::string& name : device.profiles) {
    profiles += (profiles.empty() ? "" : ", ") + name;
  }
  form.row({"profiles that fit", profiles});
  form.row({"can be used", device.usable() ? "yes" : "no"});
  for (const Obstacle& obstacle : device.obstacles) {
    form.row({"obstacle", obstacle.kind + (obstacle.blocks ? ", blocks" : ", does not block")});
  }
  if (!device.port_path.empty()) {
    const fs::path usb = fs::path(roots.sysfs) / "bus/usb/devices" / device.port_path;
    form.row({"release (bcdDevice)", driver::first_line(usb / "bcdDevice")});
    form.row({"speed, Mbit/s", driver::first_line(usb / "speed")});
    form.row({"USB descriptors", hash_of(usb / "descriptors")});
  }
  if (device.bus == "hidraw") {
    const fs::path hid = fs::path(roots.sysfs) / "class/hidraw" / fs::path(device.node).filename() /
                         "device/report_descriptor";
    form.row({"HID report descriptor", hash_of(hid)});
  }
  // Units of some makers have no serial number of their own, which the calibration has to know.
  form.row({"has a serial number", device.serial.empty() ? "no" : "yes (left out)"});
}

}  // namespace

PrivateWords private_words(const DoctorSystem& system, const std::string& root,
                           const std::vector<FoundDevice>& devices) {
  PrivateWords words;
  for (const std::string& user :
       {system.user.name, environment("USER"), environment("LOGNAME"), environment("SUDO_USER")}) {
    add(words, user, "(user)");
  }
  add(words, root, "(root)");
  add(words, environment("HOME"), "(home)");
  if (const passwd* const entry = getpwuid(getuid()); entry != nullptr) {
    add(words, entry->pw_name, "(user)");
    add(words, entry->pw_dir, "(home)");
  }
  std::array<char, 256> host{};
  if (gethostname(host.data(), host.size() - 1) == 0) {
    add_host(words, host.data());
  }
  add_host(words, driver::first_line(system.roots.proc + "/sys/kernel/hostname"));
  add_host(words, driver::first_line(system.etc + "/hostname"));
  constexpr std::size_t kShortestSerial = 4;  // a shorter one is in every text and names nobody
  for (const FoundDevice& device : devices) {
    if (device.serial.size() >= kShortestSerial) {
      add(words, device.serial, "(serial)");
    }
  }
  return words;
}

std::string without_private_words(const std::string& text, const PrivateWords& words) {
  std::vector<std::pair<std::string, std::string>> longest_first(words.begin(), words.end());
  std::stable_sort(longest_first.begin(), longest_first.end(),
                   [](const auto& a, const auto& b) { return a.first.size() > b.first.size(); });
  std::string result = text;
  for (const auto& [word, in_its_place] : longest_first) {
    const std::string wanted = lower(word);
    for (std::size_t at = lower(result).find(wanted); at != std::string::npos;) {
      const std::size_t end = at + wanted.size();
      const bool begins = at == 0 || !of_word(result[at - 1]) || !of_word(wanted.front());
      const bool ends = end == result.size() || !of_word(result[end]) || !of_word(wanted.back());
      if (begins && ends) {
        result.replace(at, wanted.size(), in_its_place);
        at += in_its_place.size();
      } else {
        ++at;
      }
      at = lower(result).find(wanted, at);
    }
  }
  return result;
}

std::string doctor_report(const ReportContent& content, const SurveyRoots& roots,
                          const PrivateWords& words) {
  Form form(words);
  form.fixed(kHead);
  write_versions(content.versions, form);
  write_findings(content.findings, form);
  form.fixed("\n## Devices\n");
  if (content.devices.empty()) {
    form.fixed("\nNone was attached.\n");
  }
  for (const FoundDevice& device : content.devices) {
    write_device(device, roots, form);
  }
  form.fixed(std::string("\n") + kBlanks);
  return form.text();
}

}  // namespace forcegrid::tools
