// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/curve_authenticator.h"

#include "simulator/workers/worker_socket.h"

namespace forcegrid::simulator {
namespace {

constexpr int kMaxQuestionsPerCall = 256;
// version, request id, domain, peer's address, identity, mechanism, public key
constexpr std::size_t kFrames = 7;

}  // namespace

CurveAuthenticator::CurveAuthenticator(zmq::context_t& context, const link::LinkKey& key)
    : questions_(context, zmq::socket_type::rep) {
  link::derive(key, link::CurveSide::kClient, client_);
  questions_.set(zmq::sockopt::linger, 0);
  questions_.bind("inproc://zeromq.zap.01");
}

void CurveAuthenticator::answer() {
  for (int i = 0; i < kMaxQuestionsPerCall; ++i) {
    const auto question = receive(questions_);
    if (!question) {
      return;
    }
    const std::vector<std::string>& frames = *question;
    const bool known = frames.size() == kFrames && frames[5] == "CURVE" &&
                       link::same_public_key(client_, frames[6].data(), frames[6].size());
    strangers_ += known ? 0 : 1;
    send(questions_, {"1.0", frames.size() > 1 ? frames[1] : "", known ? "200" : "400",
                      known ? "OK" : "another key", "", ""});
  }
}

}  // namespace forcegrid::simulator
