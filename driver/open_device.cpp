// SPDX-License-Identifier: Apache-2.0
#include "driver/open_device.h"

#include <filesystem>

#include "driver/device_url.h"
#include "driver/falcon_device.h"
#include "driver/hidraw_nodes.h"
#include "driver/hidraw_transport.h"
#include "driver/libusb_transport.h"
#include "driver/usbip_transport.h"
#include "driver/w2_device.h"

namespace forcegrid::driver {
namespace {

/// Sysfs knows nodes by the kernel's names, not by udev's links to them.
void follow_link(DeviceUrl& url) {
  std::error_code error;
  if (const auto target = std::filesystem::canonical(url.node, error); !error) {
    url.node = target.string();
  }
}

[[noreturn]] void refuse_profile(const DeviceUrl& url, const profiles::DeviceProfile& profile) {
  throw DeviceError("device '" + url.text + "': profile '" + profile.name +
                    "' describes a device of another kind (protocol " + profile.usb.protocol +
                    "); choose the device's own with --profile");
}

std::unique_ptr<Device> open_falcon(const DeviceUrl& url, const profiles::DeviceProfile& profile,
                                    const OpenOptions& options) {
  if (url.kind == DeviceUrl::Kind::kUsbip) {
    return start_falcon_device(open_usbip_bulk_transport(url, options.connect_timeout), profile,
                               options, url.text, true);
  }
  if (url.kind != DeviceUrl::Kind::kFalcon) {
    refuse_profile(url, profile);
  }
  return start_falcon_device(
      open_libusb_transport(url, profile.usb.vendor_id, profile.usb.product_id), profile, options,
      url.text, true);
}

/// The node that `url` means.
HidrawNode find_node(DeviceUrl url, const profiles::DeviceProfile& profile) {
  if (url.kind == DeviceUrl::Kind::kHidNode) {
    follow_link(url);
  }
  std::vector<HidrawNode> nodes = list_hidraw_nodes();
  if (url.kind != DeviceUrl::Kind::kHidNode) {
    nodes = without_other_interfaces(std::move(nodes), profile.usb.usage_page, profile.usb.usage);
  }
  return select_hidraw_node(url, nodes);
}

}  // namespace

std::unique_ptr<Device> open_device(const std::string& url, const profiles::DeviceProfile& profile,
                                    const OpenOptions& options) {
  const DeviceUrl parsed = parse_device_url(url);
  if (profile.usb.protocol == "falcon") {
    return open_falcon(parsed, profile, options);
  }
  if (parsed.kind == DeviceUrl::Kind::kFalcon) {
    refuse_profile(parsed, profile);
  }
  if (parsed.kind == DeviceUrl::Kind::kUsbip) {
    return start_w2_device(open_usbip_transport(parsed, options.connect_timeout), profile, options,
                           url, true);
  }
  return start_w2_device(
      open_hidraw_transport(find_node(parsed, profile), options.share, options.notice), profile,
      options, url, parsed.kind == DeviceUrl::Kind::kHidId);
}

std::string lasting_url(const std::string& url, const profiles::DeviceProfile& profile) {
  const DeviceUrl parsed = parse_device_url(url);
  if (parsed.kind != DeviceUrl::Kind::kHidId && parsed.kind != DeviceUrl::Kind::kHidNode) {
    return url;
  }
  const HidrawNode node = find_node(parsed, profile);
  return node.port_path.empty() ? url : "hid:path=" + node.port_path;
}

}  // namespace forcegrid::driver
