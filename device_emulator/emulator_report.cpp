// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/emulator_report.h"

#include <nlohmann/json.hpp>

namespace forcegrid::emulator {

void to_json(nlohmann::json& json, const FaultRecord& record) {
  json = nlohmann::json{{"name", record.name},
                        {"times", record.times},
                        {"first_ns", record.first_ns},
                        {"seconds_until_motors_off", nullptr}};
  if (record.seconds_until_motors_off) {
    json["seconds_until_motors_off"] = *record.seconds_until_motors_off;
  }
}

void to_json(nlohmann::json& json, const EmulatorReport& report) {
  json = nlohmann::json{
      {"device", report.device},
      {"busid", report.busid},
      {"hand", report.hand},
      {"final_current_mA", report.final_current_mA},
      {"max_abs_current_mA", report.max_abs_current_mA},
      {"final_torque_Nm", report.final_torque_Nm},
      {"motor_energy_delivered_J", report.motor_energy_delivered_J},
      {"motor_energy_absorbed_J", report.motor_energy_absorbed_J},
      {"seconds_since_motors_nonzero", nullptr},
      {"out_of_range_currents", report.out_of_range_currents},
      {"watchdog_trips", report.watchdog_trips},
      {"reports_sent", report.reports_sent},
      {"reports_received", report.reports_received},
      {"short_reports", report.short_reports},
      {"long_reports", report.long_reports},
      {"reports_drained", report.reports_drained},
      {"counters_loaded", report.counters_loaded},
      {"frames", report.frames},
      {"frames_late", report.frames_late},
      {"frames_skipped", report.frames_skipped},
      {"worst_lateness_us", report.worst_lateness_us},
      {"physics_skipped_s", report.physics_skipped_s},
      {"tip_position_m", report.tip_position_m},
      {"counters", report.counters},
      {"attached", report.attached},
      {"configured", report.configured},
      {"unplugged", report.unplugged},
      {"wrist", nullptr},
      {"core", nullptr},
      {"hand_target", nullptr},
      {"faults", report.faults},
      {"motors_last_on_ns", report.motors_last_on_ns},
  };
  if (report.seconds_since_motors_nonzero) {
    json["seconds_since_motors_nonzero"] = *report.seconds_since_motors_nonzero;
  }
  if (report.wrist) {
    json["wrist"] = {{"angle_rad", report.wrist->angle_rad},
                     {"orientation_wxyz", report.wrist->orientation_wxyz},
                     {"stylus_clicks", report.wrist->stylus_clicks},
                     {"final_current_mA", report.wrist->final_current_mA},
                     {"max_abs_current_mA", report.wrist->max_abs_current_mA},
                     {"final_torque_Nm", report.wrist->final_torque_Nm},
                     {"hand_torque_Nm", report.wrist->hand_torque_Nm}};
  }
  if (report.core) {
    json["core"] = {{"cycles", report.core->cycles},
                    {"answers", report.core->answers},
                    {"broken_frames", report.core->broken_frames},
                    {"silences", report.core->silences},
                    {"mean_latency_ms", report.core->mean_latency_ms},
                    {"worst_latency_ms", report.core->worst_latency_ms}};
  }
  if (report.hand_target) {
    json["hand_target"] = {{"taken", report.hand_target->taken},
                           {"malformed", report.hand_target->malformed}};
  }
  if (!report.falcon) {
    return;
  }
  for (const char* key :
       {"final_current_mA", "max_abs_current_mA", "out_of_range_currents", "short_reports",
        "long_reports", "reports_drained", "counters_loaded", "wrist", "core"}) {
    json.erase(key);
  }
  const FalconReport& falcon = *report.falcon;
  json.update({{"firmware_state", falcon.firmware_state},
               {"final_command", falcon.final_command},
               {"max_abs_command", falcon.max_abs_command},
               {"max_abs_torque_Nm", falcon.max_abs_torque_Nm},
               {"saturated_commands", falcon.saturated_commands},
               {"malformed_packets", falcon.malformed_packets},
               {"serial_overruns", falcon.serial_overruns},
               {"serial_framing_errors", falcon.serial_framing_errors},
               {"boot_handshakes", falcon.boot_handshakes},
               {"firmware_bytes_loaded", falcon.firmware_bytes_loaded},
               {"firmware_wrong_keys", falcon.firmware_wrong_keys},
               {"firmware_starts", falcon.firmware_starts},
               {"homed", falcon.homed},
               {"lights", falcon.lights},
               {"blocked_substeps", falcon.blocked_substeps}});
}

}  // namespace forcegrid::emulator
