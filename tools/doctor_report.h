// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tools/device_survey.h"
#include "tools/doctor.h"
#include "tools/library_versions.h"

namespace forcegrid::tools {

/// Words of this computer and of its devices, each with what a report says in its place.
using PrivateWords = std::map<std::string, std::string>;

/// User, home folder, host, the folder before the system's own (`root`), and the devices' serial
/// numbers. What is the same for everyone, such as the user root or the host localhost, is no
/// private word.
/// Real-time: no. Threads: any.
PrivateWords private_words(const DoctorSystem& system, const std::string& root,
                           const std::vector<FoundDevice>& devices);

/// `text` with each private word replaced where it stands as a word: between other letters and
/// digits it stays. The case of letters does not matter.
std::string without_private_words(const std::string& text, const PrivateWords& words);

struct ReportContent {
  std::vector<PartVersion> versions;
  std::vector<Finding> findings;
  std::vector<FoundDevice> devices;
};

/// A form in Markdown that the owner of a device completes and sends: the program, the computer,
/// the devices with the hashes of their USB descriptors, what was measured, and blanks for what
/// only a person can see.
///
/// It takes no remedies and none of the obstacles' texts, since these name users and programs, nor
/// the reason why a device or simulator could not be measured with, since that names its address.
/// Whatever it takes goes through without_private_words().
/// Real-time: no, it reads sysfs. Threads: any.
std::string doctor_report(const ReportContent& content, const SurveyRoots& roots,
                          const PrivateWords& words);

}  // namespace forcegrid::tools
