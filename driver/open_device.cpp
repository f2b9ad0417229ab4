#include "driver/open_device.h"

#include <filesystem>

#include "driver/device_url.h"
#include "driver/hidraw_nodes.h"
#include "driver/hidraw_transport.h"
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

}  // namespace

std::unique_ptr<Device> open_device(const std::string& url, const profiles::DeviceProfile& profile,
                                    const OpenOptions& options) {
  DeviceUrl parsed = parse_device_url(url);
  if (parsed.kind == DeviceUrl::Kind::kUsbip) {
    return start_w2_device(open_usbip_transport(parsed, options.connect_timeout), profile, options,
                           url, true);
  }
  if (parsed.kind == DeviceUrl::Kind::kHidNode) {
    follow_link(parsed);
  }
  std::vector<HidrawNode> nodes = list_hidraw_nodes();
  if (parsed.kind != DeviceUrl::Kind::kHidNode) {
    nodes = without_other_interfaces(std::move(nodes), profile.usb.usage_page, profile.usb.usage);
  }
  const HidrawNode node = select_hidraw_node(parsed, nodes);
  return start_w2_device(open_hidraw_transport(node), profile, options, url,
                         parsed.kind == DeviceUrl::Kind::kHidId);
}

}  // namespace forcegrid::driver
