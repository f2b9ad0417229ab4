# SPDX-License-Identifier: Apache-2.0
# The include paths of version 0.1 in the installed copy, for one version more: each old path of a
# header of forcegrid/ includes the header's new path and says so. Only the installed copy has them.
set(forwarded
  adaptive_grid.h              grid/adaptive_grid.h
  affine_methods.h             simple/affine_methods.h
  buffer.h                     core/buffer.h
  candle_light.h               core/radial_weight.h
  contact_field.h              kriging/contact_indexed_field.h
  contact_kernel.h             kriging/contact_kernel.h
  force_grid.h                 grid/force_grid.h
  force_method.h               core/force_method.h
  grid_factory.h               grid/grid_factory.h
  grid_geometry.h              core/grid_geometry.h
  grid_method.h                grid/grid_method.h
  grid_plan.h                  grid/grid_plan.h
  grid_segments.h              grid/grid_segments.h
  grid_storage.h               grid/grid_storage.h
  history.h                    kriging/history.h
  hold_method.h                simple/hold_method.h
  kriging_factor.h             kriging/kriging_factor.h
  kriging_field.h              kriging/kriging_field.h
  kriging_grid_method.h        kriging/kriging_grid_method.h
  kriging_hinge.h              kriging/unilateral_constraint.h
  kriging_kernel.h             kriging/kriging_kernel.h
  kriging_method.h             kriging/kriging_method.h
  kriging_simd.h               kriging/kriging_simd.h
  kriging_store.h              kriging/kriging_store.h
  kriging_store_field.h        kriging/kriging_store_field.h
  kriging_terms.h              kriging/kriging_terms.h
  linear_method.h              simple/linear_method.h
  method_options.h             core/method_options.h
  mls_grid.h                   grid/mls_grid.h
  posterior_grid.h             kriging/posterior_grid.h
  request_planner.h            grid/request_planner.h
  rls_method.h                 simple/rls_method.h
  sample_gate.h                core/sample_gate.h
  sample_spacing.h             kriging/sample_spacing.h
  spread_kernels.h             grid/spread_kernels.h
  spread_kernels_scalar.h      grid/spread_kernels_scalar.h
  spreading_grid.h             grid/spreading_grid.h)

set(FORCEGRID_FORWARDING_DIR ${PROJECT_BINARY_DIR}/forwarding)
file(REMOVE_RECURSE ${FORCEGRID_FORWARDING_DIR})
while(forwarded)
  list(POP_FRONT forwarded old new)
  if(NOT EXISTS ${PROJECT_SOURCE_DIR}/forcegrid/${new})
    message(FATAL_ERROR "ForwardingHeaders.cmake: forcegrid/${new} does not exist")
  endif()
  set(includes "#include \"forcegrid/${new}\"\n")
  if(old STREQUAL "method_options.h")
    string(APPEND includes "#include \"forcegrid/method_variant.h\"\n")
  endif()
  file(WRITE ${FORCEGRID_FORWARDING_DIR}/forcegrid/${old}
       "#pragma once\n#pragma message(\"forcegrid/${old} has moved to forcegrid/${new}; this path "
       "will be removed in version 0.3\")\n${includes}")
endwhile()
